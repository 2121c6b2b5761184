"""Key performance indicators (KPIs): what they are, formulas of a run's signals, and tracking KPIs."""

import ast
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial, reduce
from typing import Any, Literal

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import ScenarioError
from prefcal_env.units import AS_IT_IS, Conversion, conversion, plain
from prefcal_env.wording import did_you_mean

from .events import Response
from .experiment import OF_INPUT, OF_OUTPUT, SOMETIMES, Channel, Channels, Experiment, kinds_of
from .panels import output_called, plot_called

# --- Compute a KPI by a formula of a run's signals, such as "max(level) - ref(level)".

_LONGEST = 300  # characters; this also limits how deeply a formula nests
_LARGEST_POWER, _LONGEST_UNIT = 4, 100  # of a unit that is followed: x ** 999999999 must cost nothing
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
    "integral": lambda a, b, dt: (a + b) / 2 @ dt,
    "mean": lambda a, b, dt: (a + b) / 2 @ dt / dt.sum(),
    "rms": lambda a, b, dt: np.sqrt((a**2 + a * b + b**2) / 3 @ dt / dt.sum()),
}
"""Functions of lines from values a to b, each of shape (M,), and of their durations dt."""
_CURVES: Mapping[str, Any] = {"abs": np.abs, "sqrt": np.sqrt, "diff": lambda x: np.diff(x, prepend=x[:1])}
"""Functions of a curve that return a curve of the same length."""
_ALL = (*_NUMBERS, *_OVER_TIME)
_FUNCTIONS = (*_ALL, *_CURVES, "ref")


@dataclass(frozen=True, slots=True)
class Formula:
    """A formula, or a part of one; `formula_of` reads it."""

    compute: Callable[[Experiment], Any]  # of one with a record: a number, or a curve of shape (K,)
    curve: bool = False  # whether it is a curve of a signal
    # Whether its values in an experiment are held until the next one, as they are drawn
    held: Callable[[Experiment], bool] = lambda run: True
    # The unit of its values, given channels and keys of signals; "" of a number, which fits to any,
    # "?" if it is not known. Raises ScenarioError if they lack what it names.
    unit: Callable[[Channels, Collection[str]], str] = lambda channels, signals: ""
    named: bool = False  # whether it holds a signal


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
    if found.curve or not found.named:
        why = "is a curve: take its max(...), mean(...) or last(...)" if found.curve else "holds no signal"
        raise ScenarioError(f"formula {text!r:.80} {why}")
    return found


def value_of(text: str, experiment: Experiment, unit: str = "") -> float:
    """Return the value of a formula in an experiment that has a record; NaN means unknown.

    Raises ScenarioError if the experiment lacks a signal, or an output whose reference is needed, or
    the value cannot be converted to `unit`.
    """
    into = conversion_of(text, unit, experiment.channels, experiment.signals)
    with np.errstate(all="ignore"):
        return float(into.to(np.atleast_1d(formula_of(text).compute(experiment))[-1]))


def conversion_of(text: str, unit: str, channels: Channels, signals: Collection[str]) -> Conversion:
    """Return how values of a formula become values in `unit`; unchanged where a unit is not known.

    Raises ScenarioError if channels and keys of signals lack what it names, or there is no way.
    """
    found = formula_of(text).unit(channels, signals)
    if found in ("", "?") or not unit:
        return AS_IT_IS
    into = conversion(found, unit, difference="delta_" in found)
    if into is None and found != "1":  # that is a count of what the unit says
        raise ScenarioError(f"it gives {found}, which cannot be converted to {unit}")
    return into or AS_IT_IS


def _read(node: ast.AST) -> Formula:
    """Return the part of a formula at a node of its syntax tree: this list is all that is known."""
    match node:
        case ast.Constant(int() | float() as number) if not isinstance(number, bool):
            constant = np.float64(number)  # unlike an int, a power of it cannot grow without limit
            return Formula(lambda run: constant)
        case ast.Name("time"):
            span = lambda channels, _: plain(channels.time_unit)  # noqa: E731
            return Formula(lambda run: run.t - run.t[0], True, lambda run: False, span, True)
        case ast.Name(name) | ast.Constant(str(name)):
            found = partial(_unit_called, name)
            return Formula(lambda run: _values(name, run), True, lambda run: _is_held(name, run), found, True)
        case ast.Call(ast.Name("ref"), [ast.Name(name) | ast.Constant(str(name))], []):
            place = partial(output_called, name)
            unit = lambda channels, _: plain(channels.y[place(channels)].unit) or "?"  # noqa: E731
            # Beside a curve it is one, too; beside a number its last value counts.
            return Formula(lambda run: run.reference(place(run.channels)), unit=unit, named=True)
        case ast.UnaryOp(op=op) | ast.BinOp(op=op) | ast.Compare(ops=[op]) if type(op) in _OPERATORS:
            operands = [_read(each) for each in ast.iter_child_nodes(node) if isinstance(each, ast.expr)]
            return _join(_OPERATORS[type(op)], operands, partial(_unit_of_operation, node))
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
        return _join(np.maximum if name == "max" else np.minimum, parts, _common_unit)
    one = len(parts) == 1 and (parts[0].curve or name in ("abs", "sqrt"))
    if one and name in _CURVES and not window:
        return _join(_CURVES[name], parts, partial(_unit_of_function, name, ""))
    timed = window.keys() <= {"after", "before"} and not any(end.curve for end in window.values())
    if not one or name not in _ALL or not timed:
        raise ScenarioError(f"{name} takes one signal; {', '.join(_ALL)} take after= and before=, too")

    def compute(run: Experiment) -> Any:
        ends = {word: float(np.atleast_1d(end.compute(run))[-1]) for word, end in window.items()}
        span = ends.get("after", -np.inf), ends.get("before", np.inf)
        return _in_window(name, parts[0].compute(run), run.t - run.t[0], *span, held=parts[0].held(run))

    joined = _join(np.add, [*parts, *window.values()])

    def unit(channels: Channels, signals: Collection[str]) -> str:
        spans = [end.unit(channels, signals) for end in window.values()]
        _common_unit(plain(channels.time_unit), *spans)
        return _unit_of_function(name, plain(channels.time_unit), parts[0].unit(channels, signals))

    return replace(joined, compute=compute, curve=False, unit=unit)


def _values(name: str, run: Experiment) -> Any:
    """Return the curve of a signal; of an output what is measured, also where a state has its name."""
    outputs = [channel.name for channel in run.channels.y]
    measured = run.output(outputs.index(name)) if name in outputs else None
    return plot_called(name, run.channels, run.signals).values(run) if measured is None else measured


def _is_held(name: str, run: Experiment) -> bool:
    """Return whether the values of a signal hold until the next one, as those of inputs do."""
    outputs = [channel.name for channel in run.channels.y]
    return name not in outputs and plot_called(name, run.channels, run.signals).held


def _in_window(name: str, x: Any, t: Any, after: float, before: float, *, held: bool) -> Any:
    """Return a function of curve x, shape (K,), at the instants t from `after` to `before`.

    Over time the curve is as it is drawn: steps if its values are `held`, else lines.
    """
    slack = 1e-9 * t[-1]  # by which an instant may miss the end of the window
    kept = (after - slack <= t) & (t <= before + slack)
    if name not in _OVER_TIME:
        return _NUMBERS[name](x[kept]) if kept.any() else np.nan
    ends = np.clip(t, after, before)
    counts = np.diff(ends) > 0
    if counts.any():
        lines = np.interp(ends, t, x)
        left, right = (x[:-1], x[:-1]) if held else (lines[:-1], lines[1:])
        return _OVER_TIME[name](left[counts], right[counts], np.diff(ends)[counts])
    if name == "integral":
        return 0.0 if kept.any() else np.nan
    return _OVER_TIME[name](x[kept][:1], x[kept][:1], np.ones(1)) if kept.any() else np.nan


def _join(
    function: Callable[..., Any], parts: Sequence[Formula], rule: Callable[..., str] = lambda *units: "?"
) -> Formula:
    """Return the formula that applies `function` to its part, or from the first of several to the last.

    Its unit follows from those of the parts by `rule`.
    """

    def compute(run: Experiment) -> Any:
        first, *others = (part.compute(run) for part in parts)
        return np.asarray(reduce(function, others, first) if others else function(first), dtype=float)

    def held(run: Experiment) -> bool:
        return all(part.held(run) for part in parts)

    def unit(channels: Channels, signals: Collection[str]) -> str:
        return rule(*(part.unit(channels, signals) for part in parts))

    curve, named = any(part.curve for part in parts), any(part.named for part in parts)
    return Formula(compute, curve, held, unit, named)


# --- Follow the unit of a formula, so that a KPI in min of a plant in s is converted, or refused.


def _unit_called(name: str, channels: Channels, signals: Collection[str]) -> str:
    """Return the unit of a signal; of an output that of what is measured."""
    measured = [channel for channel in channels.y if channel.name == name]
    return plain((measured or [plot_called(name, channels, signals).channel])[0].unit) or "?"


def _unit_of_operation(node: ast.AST, *units: str) -> str:
    """Return the unit of an operation on values in `units`."""
    one, *others = units
    match node:
        case ast.BinOp(op=ast.Sub()):
            return _unit_of_difference(_common_unit(*units))
        case ast.BinOp(op=ast.Add()):
            return _common_unit(*units)
        case ast.Compare():
            _common_unit(*units)
            return "1"
        case ast.BinOp(op=ast.Mult()):
            return _unit_of_product(one, others[0])
        case ast.BinOp(op=ast.Div()) if not {"", "?"} & {*units}:
            ratio = f"{_unit_of_difference(one)}/({_unit_of_difference(others[0])})"
            return "1" if one == others[0] else _short(ratio)
        case ast.BinOp(op=ast.Pow(), right=ast.Constant(int(power))) if 0 < power <= _LARGEST_POWER:
            return reduce(_unit_of_product, [one] * power)
        case ast.UnaryOp():
            return one
    return "?" if any(units) else ""


def _common_unit(*units: str) -> str:
    """Return the unit of values that are added or compared; that of numbers is the same.

    Raises ScenarioError if they measure the same in different units.
    """
    there = [unit for unit in units if unit]
    if "?" in there:
        return "?"
    for other in there[1:]:
        into = conversion(other, there[0], difference="delta_" in f"{other} {there[0]}")
        if into is None:
            return "?"  # a score of several things
        if into != AS_IT_IS:
            raise ScenarioError(f"it adds or compares {there[0]} and {other}: convert one of them")
    return next((unit for unit in there if not unit.startswith("delta_")), there[0] if there else "")


def _unit_of_difference(unit: str) -> str:
    """Return the unit of a difference of values: that of temperatures has no zero of its own."""
    return f"delta_{unit}" if unit in ("degC", "degF") else unit


def _unit_of_product(one: str, other: str) -> str:
    """Return the unit of a product."""
    if "?" in (one, other) or not one or not other:
        return "?" if one or other else ""  # a number may be a factor that converts the other one
    if "1" in (one, other):
        return other if one == "1" else one
    return _short(f"{_unit_of_difference(one)}*{_unit_of_difference(other)}")


def _short(unit: str) -> str:
    """Return a unit, not known if it is long: that of x ** 4, 4 times nested, has hundreds of factors."""
    return unit if len(unit) <= _LONGEST_UNIT else "?"


def _unit_of_function(name: str, time: str, unit: str) -> str:
    """Return the unit of a function of a signal, given those of time and of the signal."""
    if name == "integral":
        return _unit_of_product(unit, time)
    return {"sqrt": "?", "diff": _unit_of_difference(unit), "peak_to_peak": _unit_of_difference(unit)}.get(
        name, unit
    )


def as_read(
    values: Float[np.ndarray, "*shape"] | float, step: Float[np.ndarray, " k"] | float = 0.0
) -> Float[np.ndarray, "*shape"]:
    """Return values as they are shown: multiples of `step`, in four significant digits.

    Args:
        values: Values of a KPI, in its unit; infinite and NaN stay.
        step: Smallest difference that is shown, in the same unit; 0 if only the digits limit it. It
            may be one for each column of `values`, shape (k,).
    """
    found = np.array(values, dtype=float)
    known = np.isfinite(found) & (found != 0)
    some, steps = found[known], np.broadcast_to(step, found.shape)[known]
    some = np.where(steps == 0, some, np.round(some / np.where(steps == 0, 1.0, steps)) * steps)
    size = np.abs(np.where(some == 0, 1.0, some))
    # Integers of any size keep all their digits, and a power of 10 above 300 would overflow.
    places = 10.0 ** np.clip(3 - np.floor(np.log10(size)), 0, 300)
    found[known] = np.round(some * places) / places + 0.0
    return found


_ROOM = 0.1  # share of the limit on a margin that studies leave between it and what they aim at


@dataclass(frozen=True, slots=True)
class KPI:
    """A key performance indicator (KPI): a number that people read off an experiment.

    Args:
        name: Key in `Experiment.kpis`.
        title: Title for people.
        unit: Unit of the values and limits.
        at_most: Largest value that meets the objective, in `unit`.
        at_least: Smallest value that meets the objective, in `unit`.
        better: Direction of improvement if there is no objective. Without a direction or an
            objective, the KPI is informational and the agent does not learn from it (for
            example, a score that a person would not write down).
        about: One sentence that explains the KPI to people.
        resolution: Smallest difference that people can see, in `unit`: values are shown, and
            simulated ones learned from, as its multiples. None for a hundredth of an objective's
            range, rounded down to a power of 10, and for 0.01 of a KPI in %; others are shown with
            four significant digits.
        formula: Formula that computes it from the signals of a run, such as "max(level) - ref(level)"
            (see docs/outcomes.md); "" if the run returns it.
        of: Name of the KPI whose value this one reads, for a direction that is not known: then an agent
            learns from one that is better lower and one that is better higher, and people see neither.
        margin: Whether it is a margin of the nominal loop, such as M_s. `prefcal verify` judges its
            limit there alone: margins are what is left for plants that differ. Studies leave room to it.

    Attributes:
        goal: Direction of improvement; "target" is the middle of the objective's range; None if
            there is no direction.
        step: Smallest difference that is shown, in `unit`; 0 if only digits limit it.

    Raises:
        ScenarioError: If `better` is not "lower", "higher" or None, if `at_least` is above
            `at_most`, `resolution` is not above 0, or `formula` cannot be read.
    """

    name: str
    title: str
    unit: str = ""
    at_most: float = np.inf
    at_least: float = -np.inf
    better: Literal["lower", "higher"] | None = None
    about: str = ""
    resolution: float | None = None
    formula: str = ""
    of: str = ""
    margin: bool = False
    goal: Literal["lower", "higher", "target"] | None = field(init=False, repr=False, compare=False)
    step: float = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if not isinstance(self.formula, str):
            raise ScenarioError(f"formula of KPI {self.name!r} must be a text, got {self.formula!r}")
        if self.formula:
            formula_of(self.formula)
        if self.resolution is not None and not 0 < self.resolution < np.inf:
            raise ScenarioError(
                f"resolution of KPI {self.name!r} must be above 0 and finite, "
                f"got {self.resolution} {self.unit}".rstrip()
            )
        if self.better not in ("lower", "higher", None):
            raise ScenarioError(
                f"better of KPI {self.name!r} must be lower, higher or None, got {self.better!r}"
            )
        if not self.at_least <= self.at_most:
            raise ScenarioError(
                f"KPI {self.name!r}: at_least must not be above at_most, "
                f"got {self.at_least} and {self.at_most} {self.unit}".rstrip()
            )
        below, above = np.isfinite([self.at_most, self.at_least])
        goal = "target" if below and above else "lower" if below else "higher" if above else None
        object.__setattr__(self, "goal", self.better or goal)
        object.__setattr__(self, "step", self._step())

    def _step(self) -> float:
        if self.resolution is not None:
            return self.resolution
        width = self.at_most - self.at_least
        if np.isfinite(width) and width > 0:
            return float(10.0 ** np.floor(np.log10(width / 100)))
        return 0.01 if self.unit == "%" else 0.0

    @property
    def aim(self) -> float | None:
        """Return the value a tenth within the limit of a margin, which studies aim at; None without one.

        A tuning at the limit has that margin on the nominal plant only.
        """
        end = {"lower": self.at_most, "higher": self.at_least}.get(self.goal or "", np.inf)
        if not self.margin or not np.isfinite(end):
            return None
        aim = self.read(end + (1 if self.goal == "higher" else -1) * _ROOM * abs(end))
        return None if aim == end else aim  # of a coarse one, a tenth cannot be read

    def read(self, value: float) -> float:
        """Return `value` as it is shown: in multiples of `step`, with four significant digits."""
        return float(as_read(value, self.step))

    def judged(self, value: float) -> float:
        """Return how bad `value` looks: equal for values that read the same or meet a target."""
        if self.goal == "target" and self.met(value):
            return 0.0
        return float(self.badness(self.read(value)))

    def badness(self, values: Float[np.ndarray, "*shape"] | float) -> Float[np.ndarray, "*shape"] | float:
        """Return values so that lower is better, in the same shape; NaN if one could not be measured."""
        if self.goal == "target":
            return np.abs(values - (self.at_most + self.at_least) / 2)
        found = np.negative(values) if self.goal == "higher" else values
        return np.where(np.equal(found, -np.inf), np.nan, found)[()]  # nothing is infinitely good

    def met(self, value: float) -> bool | None:
        """Return whether `value`, as read, meets the objective; None if there is no objective."""
        if np.isinf(self.at_most) and np.isinf(self.at_least):
            return None
        return bool(self.at_least <= self.read(value) <= self.at_most)

    def met_by(self, experiment: Experiment) -> bool | None:
        """Return whether an experiment meets the objective; None without one or a value.

        An unstable loop does not, whether or not its margin has one.
        """
        value = experiment.kpis.get(self.name)
        return False if self.unstable(experiment) else None if value is None else self.met(value)

    def unstable(self, experiment: Experiment) -> bool:
        """Return whether this is a margin that an experiment does not have, since its loop is not stable."""
        value = experiment.kpis.get(self.name)
        return self.margin and value == (np.inf if self.goal == "lower" else 0.0)


# --- Tracking KPIs: those of any experiment with references, errors of outputs and moves of inputs.
#
# An agent learns which of them matter to a person (`Answer.outcomes`); none is a cost by itself.


def tracking_kpis(experiment: Experiment) -> dict[str, float]:
    """Return generic KPIs by name, lower is better, in the units of the experiment's channels.

    For each recorded output with a reference (see `Experiment.output`), its events are found first
    (see `events.Event`): a start away from the reference, steps and ramps of the reference, and
    loads. The settling time and the overshoot are the worst of all starts and changes, the lag is
    that of ramps, the recovery time that of loads; a record without such an event has neither of
    the last two. The integrated error, that weighted with the time since the latest start or
    change, and the final error beyond a thousandth of the largest are those of the whole record.
    For each input: the total, largest and root mean square move. An experiment without a record
    has no KPIs.
    """
    if len(experiment.t) < 2:
        return {}
    found: dict[str, float] = {}
    for channel, response in _responses(experiment):
        found |= {f"{kind} of {channel.name}": value for kind, value in _of_response(response)}
    for j, channel in enumerate(experiment.channels.u):
        moves = np.abs(np.diff(experiment.u_control[:, j]))
        if len(moves):
            sizes = moves.sum(), moves.max(), np.sqrt(np.mean(moves**2))
            kinds = (kind for kind, *_ in OF_INPUT)
            found |= {f"{n} of {channel.name}": float(v) for n, v in zip(kinds, sizes, strict=True)}
    return found


def _responses(experiment: Experiment) -> Iterator[tuple[Channel, Response]]:
    """Yield channel and response of each output with a reference, on the dense grid.

    A reference that is logged on change may not be known before its first value.
    """
    for j, channel in enumerate(experiment.channels.y):
        reference, curve = experiment.reference(j), experiment.output(j)
        first = int(np.argmax(np.isfinite(reference)))
        t, r = experiment.t[first:], reference[first:]
        if curve is not None and len(t) > 1 and np.isfinite(r).all() and np.isfinite(curve).all():
            yield channel, Response.of(t, np.asarray(curve)[first:], r, channel.band)


def _of_response(response: Response) -> Iterator[tuple[str, float]]:
    """Yield kind and value of each KPI of an output, in the order of `OF_OUTPUT`."""
    error, late = response.areas()
    size = np.abs(response.y - response.r)
    yield "integrated error", error
    yield "late error", late
    yield "settling time", max(map(response.settling_time, response.changes))
    yield "overshoot", max(map(response.overshoot, response.changes))
    yield "final error", max(float(size[-1] - 1e-3 * size.max()), 0.0)  # less is invisible
    ramps = [event for event in response.events if event.kind == "ramp"]
    if ramps:
        yield "lag", max(map(response.lag, ramps))
    if response.loads:
        yield "recovery time", max(map(response.settling_time, response.loads))


def every_tracking_kpi(channels: Channels) -> dict[str, KPI]:
    """Return the tracking KPIs that channels allow, by name, as if all outputs had references."""
    return {
        name: KPI(name, name, unit, better="lower", about=about) for name, unit, about in kinds_of(channels)
    }


def found_kpis(channels: Channels, measured: Iterable[str] | None = None) -> tuple[KPI, ...]:
    """Return the few tracking KPIs to show to people, the most important first.

    Args:
        channels: Channels of the experiments.
        measured: KPIs of an experiment: only these are found. With None, those of the outputs
            with a target, and of the inputs.
    """
    aimed = tuple(c for c in channels.y if c.target is not None or measured is not None)
    every = every_tracking_kpi(Channels((), channels.u, aimed, channels.time_unit))
    there = [n for n in every if measured is None or n in measured]
    if not any(name.startswith(tuple(kind for kind, *_ in OF_OUTPUT)) for name in there):
        return ()  # nothing is tracked: moves alone would ask for a controller that does nothing
    # As they are shown; what needs a load or a ramp is found where there is one.
    kinds = ["settling time", "recovery time", "overshoot", "lag", "integrated error", "total move"]
    kinds = [kind for kind in kinds if measured is not None or kind not in SOMETIMES]
    # Left out until people can read them
    for kind in ("", "lag", "recovery time", "integrated error", "overshoot", "total move"):
        kinds = [k for k in kinds if k != kind]
        names = [n for k in kinds for n in there if n.startswith(f"{k} of ")]
        if len(names) <= 10:
            break
    return tuple(every[name] for name in names)


@dataclass(frozen=True, slots=True)
class Tracking:
    """Function that returns the KPIs of an experiment, and its tracking KPIs."""

    names: tuple[str, ...] = ()  # KPIs that every complete experiment has, NaN if it could not be measured

    @classmethod
    def promised(cls, channels: Channels | None, names: Sequence[str]) -> "Tracking":
        """Promise those of `names` that channels allow, since others lack a target; all if unknown."""
        there = names if channels is None else {kpi.name for kpi in found_kpis(channels)}
        return cls(tuple(name for name in names if name in there))

    def __call__(self, experiment: Experiment) -> Mapping[str, float]:
        """Return the KPIs of an experiment by name; its own count."""
        unknown = {} if experiment.end.interrupted else dict.fromkeys(self.names, np.nan)
        return {**unknown, **tracking_kpis(experiment), **experiment.kpis}


@dataclass(frozen=True, slots=True)
class Formulas:
    """Function that returns the KPIs of an experiment, and those of formulas: name, text and unit."""

    texts: tuple[tuple[str, str, str], ...]

    def __call__(self, experiment: Experiment) -> Mapping[str, float]:
        """Return the KPIs of an experiment by name; the formulas count, if there is a record.

        Raises ScenarioError if the experiment lacks what a formula names.
        """
        found = dict(experiment.kpis)
        for name, text, unit in self.texts if len(experiment.t) else ():
            try:
                found[name] = value_of(text, experiment, unit)
            except ScenarioError as error:
                raise ScenarioError(f"formula of KPI {name!r}: {error}") from error
        return found
