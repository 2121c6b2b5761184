"""The run-time checker of array shapes in the tests: jaxtyping and beartype, with latitude."""

import inspect
from dataclasses import is_dataclass
from functools import partial, wraps
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
MOST = 60
"""Calls of one function that are checked in one test. A check takes much longer than most of what
is checked, and the shapes of the thousandth call are those of the first ones."""


class Test:
    """The test that runs: each one checks the first calls anew."""

    number = 0


def jaxtyped(function: Any = _ABSENT, **options: Any) -> Any:
    """As jaxtyping's own, but only where there is a shape, and only the first calls of a test."""
    if function is _ABSENT:
        return partial(jaxtyped, **options)
    if isinstance(function, classmethod | staticmethod):
        return type(function)(jaxtyped(function.__func__, **options))
    if isinstance(function, property):
        parts = (function.fget, function.fset, function.fdel)
        return property(*(part and jaxtyped(part, **options) for part in parts))
    if inspect.isclass(function):
        made = vars(function).get("__init__")
        if is_dataclass(function) and made is not None and not hasattr(made, "__wrapped__"):
            function.__init__ = jaxtyped(made, **options)
        return function
    if not _mentions_shape(function):
        return function
    return _at_first(function, partial(_jaxtyped, function, **options))


def _at_first(function: Any, make: Any) -> Any:
    test, calls, checked = -1, 0, None

    @wraps(function)
    def call(*args: Any, **kwargs: Any) -> Any:
        nonlocal test, calls, checked
        if test != Test.number:
            test, calls = Test.number, 0
        if calls >= MOST:
            return function(*args, **kwargs)
        calls += 1
        checked = checked or make()  # it takes a while, and many are never called
        return checked(*args, **kwargs)

    return call


def _mentions_shape(function: Any) -> bool:
    hints = getattr(function, "__annotations__", {})
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
