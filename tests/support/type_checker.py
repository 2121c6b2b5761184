"""The run-time checker of array shapes in the tests: jaxtyping and beartype, with latitude."""

import inspect
from functools import partial
from typing import Any, get_args

import jaxtyping
import numpy as np
from beartype import BeartypeConf, beartype
from beartype.roar import BeartypeDecorHintException
from jaxtyping import AbstractArray, Float, Real

_LATITUDE = BeartypeConf(is_pep484_tower=True)  # an int is a float


def check(function: Any) -> Any:
    """Check the shapes of arrays in calls of `function`; the rest is for the static checker.

    `function` has the annotations of one of ours, and no body: it is changed here. Where floats
    are wanted whole numbers will do, and lists, which have no shape, pass.
    """
    hints = function.__annotations__
    function.__annotations__ = {k: _lenient(h) for k, h in hints.items() if _has_shape(h)}
    try:
        return beartype(conf=_LATITUDE)(function) if function.__annotations__ else function
    except BeartypeDecorHintException:  # beside the array a hint that only a class could check
        return function


_ABSENT, _jaxtyped = object(), jaxtyping.jaxtyped


def jaxtyped(function: Any = _ABSENT, **options: Any) -> Any:
    """As jaxtyping's own, which costs microseconds a call, but only where there is a shape."""
    if function is _ABSENT:
        return partial(jaxtyped, **options)
    return _jaxtyped(function, **options) if _mentions_shape(function) else function


def _mentions_shape(function: Any) -> bool:
    if inspect.isclass(function):
        return _mentions_shape(function.__init__)  # of a dataclass: its fields
    if isinstance(function, property):
        return any(map(_mentions_shape, (function.fget, function.fset, function.fdel)))
    hints = getattr(getattr(function, "__func__", function), "__annotations__", {})
    return any(isinstance(hint, str) or _has_shape(hint) for hint in hints.values())


def _has_shape(hint: Any) -> bool:
    if _is_array(hint):
        return True
    return any(_has_shape(inner) for inner in get_args(hint))


def _lenient(hint: Any) -> Any:
    if _is_array(hint) and hint.dtypes == Float.dtypes:
        return Real[np.ndarray, hint.dim_str] | list | tuple
    return hint


def _is_array(hint: Any) -> bool:
    return isinstance(hint, type) and issubclass(hint, AbstractArray)
