"""Compute a KPI by a formula of a run's signals, such as "max(level) - ref(level)"."""

import ast
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial, reduce
from typing import Any

import numpy as np

from prefcal_env.errors import ScenarioError
from prefcal_env.wording import did_you_mean

from .experiment import Channels, Experiment
from .panels import output_called, plot_called

_LONGEST = 300  # characters; this also limits how deeply a formula nests
_OPERATORS: Mapping[type, Callable[..., Any]] = {
    ast.Add: np.add,
    ast.Sub: np.subtract,
    ast.Mult: np.multiply,
    ast.Div: np.divide,
    ast.Pow: np.power,
    ast.USub: np.negative,
    ast.Lt: np.less,
    ast.LtE: np.less_equal,
    ast.Gt: np.greater,
    ast.GtE: np.greater_equal,
}
_NUMBERS: Mapping[str, Callable[..., Any]] = {
    "max": np.max,
    "min": np.min,
    "sum": np.sum,
    "first": lambda x: x[0],
    "last": lambda x: x[-1],
    "peak_to_peak": np.ptp,
}
"""Functions of the samples of a curve, shape (M,), that return a number."""
_OVER_TIME: Mapping[str, Callable[..., Any]] = {
    "integral": lambda x, dt: x @ dt,
    "mean": lambda x, dt: x @ dt / dt.sum(),
    "rms": lambda x, dt: np.sqrt(x**2 @ dt / dt.sum()),
}
"""Functions of values and how long each is held, shape (M,): until the next one, as in tracking_kpis."""
_CURVES: Mapping[str, Any] = {"abs": np.abs, "sqrt": np.sqrt, "diff": lambda x: np.diff(x, prepend=x[:1])}
"""Functions of a curve that return a curve of the same length."""
_ALL = (*_NUMBERS, *_OVER_TIME)
_FUNCTIONS = (*_ALL, *_CURVES, "ref")
_ROUNDING = 1e-9
"""Share of a run's duration by which an instant may miss the end of a window."""


@dataclass(frozen=True, slots=True)
class Formula:
    """A formula, or a part of one; `formula_of` reads it.

    Args:
        compute: Function of an experiment with a record: a number, or a curve of shape (K,).
        curve: Whether it is a curve of a signal.
        names: Functions of channels and keys of signals that find what it names, or raise ScenarioError.
    """

    compute: Callable[[Experiment], Any]
    curve: bool = False
    names: tuple[Callable[[Channels, Collection[str]], Any], ...] = ()


@lru_cache(maxsize=256)
def formula_of(text: str) -> Formula:
    """Return the formula that `text` says; nothing in it is ever executed as Python.

    Raises:
        ScenarioError: If it is no number made of signals by what docs/outcomes.md lists.
    """
    if not isinstance(text, str) or len(text) > _LONGEST:
        raise ScenarioError(f"a formula must be at most {_LONGEST} characters of text, got {text!r:.80}")
    try:
        found = _read(ast.parse(text.strip(), mode="eval").body)
    except (SyntaxError, ValueError, OverflowError, RecursionError, MemoryError) as error:
        raise ScenarioError(f"formula {text!r:.80}: {getattr(error, 'msg', error)}") from error
    if found.curve or not (found.names or "time" in text):
        why = "is a curve: take its max(...), mean(...) or last(...)" if found.curve else "holds no signal"
        raise ScenarioError(f"formula {text!r:.80} {why}")
    return found


def value_of(text: str, experiment: Experiment) -> float:
    """Return the value of a formula in an experiment that has a record; NaN means unknown.

    Raises ScenarioError if the experiment lacks a signal, or an output whose reference is needed.
    """
    with np.errstate(all="ignore"):
        return float(np.atleast_1d(formula_of(text).compute(experiment))[-1])


def _read(node: ast.AST) -> Formula:
    """Return the part of a formula at a node of its syntax tree: this list is all that is known."""
    match node:
        case ast.Constant(int() | float() as number) if not isinstance(number, bool):
            constant = np.float64(number)  # unlike an int, a power of it cannot grow without limit
            return Formula(lambda run: constant)
        case ast.Name("time"):
            return Formula(lambda run: run.t - run.t[0], True)
        case ast.Name(name) | ast.Constant(str(name)):
            find = partial(plot_called, name)
            return Formula(lambda run: _values(name, run), True, (find,))
        case ast.Call(ast.Name("ref"), [ast.Name(name) | ast.Constant(str(name))], []):
            place = partial(output_called, name)
            # Beside a curve it is one, too; beside a number its last value counts.
            return Formula(lambda run: run.reference(place(run.channels)), False, (place,))
        case ast.UnaryOp(op=op) | ast.BinOp(op=op) | ast.Compare(ops=[op]) if type(op) in _OPERATORS:
            operands = [_read(each) for each in ast.iter_child_nodes(node) if isinstance(each, ast.expr)]
            return _joined(_OPERATORS[type(op)], operands)
        case ast.Call(ast.Name(name), arguments, words):
            return _called(name, [*map(_read, arguments)], {word.arg: _read(word.value) for word in words})
    raise ScenarioError(
        f"it cannot hold {ast.unparse(node)!r:.60}: write numbers, names of signals (in quotes if "
        f"they hold more than letters, digits and _), + - * / **, <, >, and {', '.join(_FUNCTIONS)}"
    )


def _called(name: str, parts: Sequence[Formula], window: Mapping[str | None, Formula]) -> Formula:
    """Return the call of one of the functions but `ref`."""
    if name not in _FUNCTIONS:
        hint = did_you_mean(name, _FUNCTIONS)
        raise ScenarioError(f"there is no function {name!r}.{hint} Expected one of {', '.join(_FUNCTIONS)}")
    if name in ("max", "min") and len(parts) > 1 and not window:
        return _joined(np.maximum if name == "max" else np.minimum, parts)
    one = len(parts) == 1 and (parts[0].curve or name in ("abs", "sqrt"))
    if one and name in _CURVES and not window:
        return _joined(_CURVES[name], parts)
    timed = window.keys() <= {"after", "before"} and not any(end.curve for end in window.values())
    if not one or name not in _ALL or not timed:
        raise ScenarioError(f"{name} takes one signal; {', '.join(_ALL)} take after= and before=, too")

    def compute(run: Experiment) -> Any:
        ends = {word: float(np.atleast_1d(end.compute(run))[-1]) for word, end in window.items()}
        span = ends.get("after", -np.inf), ends.get("before", np.inf)
        return _in_window(name, parts[0].compute(run), run.t - run.t[0], *span)

    return replace(_joined(np.add, [*parts, *window.values()]), compute=compute, curve=False)


def _values(name: str, run: Experiment) -> Any:
    """Return the curve of a signal; of an output what is measured, also where a state has its name."""
    outputs = [channel.name for channel in run.channels.y]
    measured = run.output(outputs.index(name)) if name in outputs else None
    return plot_called(name, run.channels, run.signals).values(run) if measured is None else measured


def _in_window(name: str, x: Any, t: Any, after: float, before: float) -> Any:
    """Return a function of curve x, shape (K,), at the instants t from `after` to `before`."""
    slack = _ROUNDING * t[-1]
    kept = (after - slack <= t) & (t <= before + slack)
    if name in _OVER_TIME:
        held = np.diff(np.clip(t, after, before))
        counts = held > 0
        if counts.any():
            return _OVER_TIME[name](x[:-1][counts], held[counts])
        if name == "integral":
            return 0.0 if kept.any() else np.nan
        return _OVER_TIME[name](x[kept][:1], np.ones(1)) if kept.any() else np.nan
    return _NUMBERS[name](x[kept]) if kept.any() else np.nan


def _joined(function: Callable[..., Any], parts: Sequence[Formula]) -> Formula:
    """Return the formula that applies `function` to its part, or from the first of several to the last."""

    def compute(run: Experiment) -> Any:
        first, *others = (part.compute(run) for part in parts)
        return np.asarray(reduce(function, others, first) if others else function(first), dtype=float)

    names = tuple(name for part in parts for name in part.names)
    return Formula(compute, any(part.curve for part in parts), names)
