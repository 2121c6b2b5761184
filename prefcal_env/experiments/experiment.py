"""One closed-loop run of one θ, frozen: its trajectory, what the controller did, and its notebook view."""

import base64
import io
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, fields, replace
from enum import Enum
from html import escape
from math import ceil, floor
from typing import Any, NoReturn, Protocol, Self

import numpy as np
from jaxtyping import Float, Int

from prefcal_env.errors import ExperimentError, ScenarioError
from prefcal_env.units import same
from prefcal_env.wording import brief, labeled, place_in_code

# --- Why an experiment ended. Besides the KPIs, this is all that an agent learns about a run.


class End(Enum):
    """Why an experiment ended; `CUT_SHORT`: it was stopped since it could no longer win."""

    TIME_UP = "time is up"
    SETTLED = "settled"
    CUT_SHORT = "cut short"
    UNSAFE = "unsafe"
    FAILED = "failed"

    @property
    def interrupted(self) -> bool:
        """Whether it was stopped before its natural end."""
        return self in (End.CUT_SHORT, End.UNSAFE, End.FAILED)


BEST_FIRST = (End.SETTLED, End.TIME_UP, End.CUT_SHORT, End.UNSAFE, End.FAILED)
"""Ends of a run, from the best to the worst."""


# --- Kinds of tracking KPIs: their names, units and meanings, which need no experiment.

Kind = tuple[str, str, str]
"""Name of a kind of KPI, its unit for a channel with {unit} and for {time}, and its meaning."""
OF_OUTPUT: tuple[Kind, ...] = (
    ("integrated error", "{unit} {time}", "Area between the curve and its reference."),
    (
        "late error",
        "{unit} {time}²",
        "Area between the curve and its reference, weighted with the time since the latest change.",
    ),
    (
        "settling time",
        "{time}",
        "Time from a change of the reference until the curve stays in the band around it.",
    ),
    ("overshoot", "{unit}", "Largest distance beyond the reference, on the other side than it comes from."),
    ("final error", "{unit}", "Distance from the reference at the end."),
    ("lag", "{time}", "Time by which the curve trails a ramp of its reference."),
    ("recovery time", "{time}", "Time from a load until the curve stays in the band around its reference."),
)
"""Kinds of each output with a reference."""
SOMETIMES = ("lag", "recovery time")  # those that need a ramp or a load, so that no run promises them
OF_INPUT: tuple[Kind, ...] = (
    ("total move", "{unit}", "Sum of all changes of the input: how much the actuator works."),
    ("largest move", "{unit}", "Largest change of the input from one instant to the next."),
    ("RMS move", "{unit}", "Root mean square of the changes of the input."),
)
"""Kinds of each input, likewise."""


def kinds_of(channels: Any) -> Iterator[tuple[str, str, str]]:
    """Yield name, unit and meaning of each KPI of `Channels`, as if all outputs had references."""
    for kinds, group in ((OF_OUTPUT, channels.y), (OF_INPUT, channels.u)):
        for channel in group:
            for kind, unit, about in kinds:
                plain = unit.format(unit=channel.unit, time=channels.time_unit)
                yield f"{kind} of {channel.name}", plain.strip(), about


# --- The data that an environment and a controller exchange once every sampling period.


@dataclass(frozen=True, slots=True)
class Measurement:
    """Everything that a controller knows at a sampling instant, in the plant's units.

    Args:
        t: Time since the start.
        x: State, measured or estimated, shape (n_x,). `PlantEnv` gives the true one.
        u: Input applied during the last sampling period, shape (n_u,).
        d: Measured disturbances, shape (n_d,), or their preview, one row for each step, (N, n_d).
        y_ref: Output references, shape (n_y,), or their preview for y_1 ... y_N, shape (N, n_y).
        y: Outputs as they are measured, with noise and dead time if the task has them, shape
            (n_y,); empty if the environment measures none.
    """

    t: float
    x: Float[np.ndarray, " n_x"]
    u: Float[np.ndarray, " n_u"]
    d: Float[np.ndarray, "*d"]
    y_ref: Float[np.ndarray, "*y"]
    y: Float[np.ndarray, " _"] = field(default_factory=lambda: np.zeros(0))


@dataclass(frozen=True, slots=True)
class Move:
    """The decision of a controller.

    Args:
        u: Input to apply, shape (n_u,), in the plant's units.
        iterations: Number of solver iterations; 0 if there is no solver.
        solved: Whether the problem was solved; if not, the last input is held.
    """

    u: Float[np.ndarray, " n_u"]
    iterations: int = 0
    solved: bool = True


class Controller(Protocol):
    """A control law with its memory (such as an integrator), made anew for each experiment."""

    @property
    def T_s(self) -> float:
        """Sampling time, in the plant's unit of time."""

    def move(self, measurement: Measurement) -> Move:
        """Decide the input for the next sampling period."""


@dataclass(frozen=True, slots=True)
class Channel:
    """A signal of an experiment: its name, unit, limits and target.

    Args:
        name: Name, as shown to people.
        unit: Unit of the values.
        low: Lower limit, in `unit`.
        high: Upper limit, in `unit`.
        target: Desired value, in `unit`.
        band: Accepted distance from the target, in `unit`.
        symbol: Mathtext symbol for plots.

    Raises:
        ExperimentError: If name or unit is not text, `low` is not below `high`, or the band is negative.
    """

    name: str
    unit: str = ""
    low: float = -np.inf
    high: float = np.inf
    target: float | None = None
    band: float | None = None
    symbol: str = ""

    def __post_init__(self) -> None:
        if not (isinstance(self.name, str) and isinstance(self.unit, str)):
            raise ExperimentError(
                f"a channel has a name and a unit, as text, got {self.name!r} {self.unit!r}"
            )
        if not self.low < self.high:
            raise ExperimentError(
                f"channel {self.name!r}: low must be below high, "
                f"got [{self.low}, {self.high}] {self.unit}".rstrip()
            )
        if self.band is not None and not self.band >= 0:
            raise ExperimentError(
                f"channel {self.name!r}: band must be 0 or more, got {self.band} {self.unit}".rstrip()
            )

    @property
    def label(self) -> str:
        """Name with unit, for the axis of a plot."""
        return labeled(self.name, self.unit)

    def scaled(self, factor: float, offset: float = 0.0) -> Self:
        """Return the channel with each value v as factor · v + offset, under the same unit."""
        # A negative factor turns the limits round.
        low, high = sorted((factor * self.low + offset, factor * self.high + offset))
        target = None if self.target is None else factor * self.target + offset
        # A distance: it has no offset.
        band = None if self.band is None else abs(factor) * self.band
        return replace(self, low=low, high=high, target=target, band=band)


@dataclass(frozen=True, slots=True)
class Channels:
    """The channels of an experiment: states, inputs and outputs, and the unit of time."""

    x: tuple[Channel, ...]
    u: tuple[Channel, ...]
    y: tuple[Channel, ...]
    time_unit: str = "s"


class FrozenMapping(dict[str, Any]):
    """An immutable mapping that compares by value (arrays too) and can be pickled."""

    # A dict, not a proxy: JSON, pickle and notebooks know dicts.
    def _refuse(self, *_: object, **__: object) -> NoReturn:
        raise TypeError(f"a {type(self).__name__} cannot be changed: make a new one")

    __setitem__ = __delitem__ = __ior__ = _refuse
    update = setdefault = pop = popitem = clear = _refuse

    def __reduce__(self) -> tuple[type[Self], tuple[dict[str, Any]]]:
        """Return how to make it again: pickle would fill it item by item."""
        return type(self), (dict(self),)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Mapping):
            return NotImplemented
        return self.keys() == other.keys() and all(_same(v, other[k]) for k, v in self.items())

    __hash__ = None

    def __repr__(self) -> str:
        return f"{type(self).__name__}({dict(self)!r})"


@dataclass(frozen=True, eq=False)
class Experiment:
    """One closed-loop run of one θ. Times are in `channels.time_unit`.

    A run has K dense instants and N control steps (the last sampling interval may end early). K
    and N are 0 if a run failed and left no record.

    Args:
        theta: Controller parameters, physical, shape (n,).
        t: Dense instants, shape (K,), increasing. They include the sampling instants and the end;
            their density does not depend on T_s.
        x: States at `t`, shape (K, n_x), finite even if the run was stopped.
        u: Inputs held from `t` on, shape (K, n_u).
        t_control: Sampling instants, at which an input was decided, shape (N,).
        u_control: Inputs decided at `t_control`, shape (N, n_u).
        y_ref: Output references at `t_control`, shape (N, n_y).
        iterations: Number of solver iterations in each step, shape (N,).
        solve_time: Duration of each controller step in seconds, shape (N,); ignored by ==.
        solved: Whether each step's problem was solved, shape (N,). If not, the input was held.
        channels: Names, units, limits and targets.
        end: Why the run ended.
        kpis: Key performance indicators by name; the scenario knows their units.
        signals: Additional signals on `t` by name, each of shape (K,).
        runs: All of several seeded variants or maneuvers; the other fields are those of the first
            one. Variants are drawn together, maneuvers (see `combined`) apart.
        y: Outputs at `t`, shape (K, n_y); None if they were not recorded (see `output`).
        maneuver: Name of this run among several maneuvers; "" if there is only one.

    Raises:
        ExperimentError: If an array has the wrong shape, states or inputs are not finite, KPIs or
            signals are not a mapping, or a KPI is not a number.
    """

    theta: Float[np.ndarray, " n"]
    t: Float[np.ndarray, " K"]
    x: Float[np.ndarray, "K n_x"]
    u: Float[np.ndarray, "K n_u"]
    t_control: Float[np.ndarray, " N"]
    u_control: Float[np.ndarray, "N n_u"]
    y_ref: Float[np.ndarray, "N n_y"]
    iterations: Int[np.ndarray, " N"]
    solve_time: Float[np.ndarray, " N"]
    solved: Any
    channels: Channels
    end: End
    kpis: Mapping[str, float] = field(default_factory=FrozenMapping)
    signals: Mapping[str, Float[np.ndarray, " K"]] = field(default_factory=FrozenMapping)
    runs: tuple["Experiment", ...] = ()
    y: Float[np.ndarray, "K n_y"] | None = None
    maneuver: str = ""

    def __post_init__(self) -> None:
        for name, dtype in ARRAYS.items():
            object.__setattr__(self, name, _frozen(getattr(self, name), dtype))
        # None is something else than outputs of no length: then states of the same name stand for y.
        if self.y is not None:
            object.__setattr__(self, "y", _frozen(self.y, float))
        signals = _mapping("signals", self.signals)
        frozen = FrozenMapping({k: _frozen(v, float) for k, v in signals.items()})
        object.__setattr__(self, "signals", frozen)
        object.__setattr__(self, "kpis", _checked_kpis(self.kpis))
        self._check()

    def _check(self) -> None:
        n_x, n_u, n_y = (len(c) for c in (self.channels.x, self.channels.u, self.channels.y))
        # A number in place of an array is told by its shape below, not by a TypeError here.
        dense, steps = len(np.atleast_1d(self.t)), len(np.atleast_1d(self.t_control))
        expected: dict[str, tuple[int, ...]] = {"t": (dense,), "x": (dense, n_x), "u": (dense, n_u)}
        expected |= {"t_control": (steps,), "u_control": (steps, n_u), "y_ref": (steps, n_y)}
        expected |= dict.fromkeys(("iterations", "solve_time", "solved"), (steps,))
        if self.y is not None:
            expected["y"] = (dense, n_y)
        arrays = {name: getattr(self, name) for name in expected}
        for name, array in (arrays | {f"signals[{k!r}]": v for k, v in self.signals.items()}).items():
            shape = expected.get(name, (dense,))
            if np.shape(array) != shape:
                raise ExperimentError(f"{name} must have shape {shape}, got {np.shape(array)}")
        # y and y_ref may have NaN: an output that was not measured, or has no reference.
        for name in ("theta", "t", "x", "u", "t_control", "u_control"):
            if not np.isfinite(getattr(self, name)).all():
                raise ExperimentError(f"{name} must be finite, even in a run that was stopped")
        if self.theta.ndim != 1 or not len(self.theta):
            raise ExperimentError(f"theta must have shape (n,), got {self.theta.shape}")
        if not isinstance(self.maneuver, str):
            raise ExperimentError(f"maneuver must be a name, got {self.maneuver!r}")
        if not isinstance(self.end, End):
            raise ExperimentError(f"end must be one of {list(End)}, got {self.end!r}")
        if not (self.t[1:] > self.t[:-1]).all():
            raise ExperimentError("t must increase strictly")

    @classmethod
    def blank(
        cls,
        theta: Float[np.ndarray, " n"],
        channels: Channels,
        end: End,
        kpis: Mapping[str, float] | None = None,
    ) -> "Experiment":
        """Return an experiment of θ, physical, shape (n,), that left no record, with these KPIs."""
        x, u, y = (np.zeros((0, len(each))) for each in (channels.x, channels.u, channels.y))
        # As its successful siblings have them: outputs that are states are not stored twice.
        measured = {(c.name, c.unit) for c in channels.y} - {(c.name, c.unit) for c in channels.x}
        none = np.zeros(0)
        return cls(
            theta,
            none,
            x,
            u,
            t_control=none,
            u_control=u,
            y_ref=y,
            iterations=np.zeros(0, dtype=np.int64),
            solve_time=none,
            solved=np.zeros(0, dtype=bool),
            channels=channels,
            end=end,
            kpis=kpis or {},
            y=y if measured else None,
        )

    def with_kpis(self, kpis: "Mapping[str, float] | KPIs") -> "Experiment":
        """Return this experiment with other KPIs; it shares the arrays, which are checked already.

        Args:
            kpis: KPIs by name, or a function that computes them of this experiment.

        Raises:
            ExperimentError: If `kpis` is not a mapping from names to numbers, or returns none.
        """
        other = copy(self)
        found = compute(kpis, self) if callable(kpis) else kpis
        object.__setattr__(other, "kpis", _checked_kpis(found))
        return other

    @property
    def duration(self) -> float:
        """Time from the first to the last instant, in `channels.time_unit`; 0 without a record."""
        return float(self.t[-1] - self.t[0]) if len(self.t) else 0.0

    def output(self, index: int) -> Float[np.ndarray, " K"] | None:
        """Return the output with number `index` (from 0) at `t`, shape (K,).

        If `y` was not recorded, return the state of the same name and unit, or else the signal of
        the same name, or else None.
        """
        if self.y is not None:
            return np.asarray(self.y[:, index])
        channel = self.channels.y[index]
        for i, state in enumerate(self.channels.x):
            if state.name == channel.name and (state.unit == channel.unit or same(state.unit, channel.unit)):
                return np.asarray(self.x[:, i])
        return self.signals.get(channel.name)

    def reference(self, index: int) -> Float[np.ndarray, " K"]:
        """Return the reference of output `index` (from 0), held from step to step, shape (K,).

        It is NaN where the output has none, and everywhere if no step was recorded.
        """
        if not len(self.t_control):
            return np.full(len(self.t), np.nan)
        # "right": at a sampling instant the new reference holds. Instants before the first get the first.
        held = np.searchsorted(self.t_control, self.t, side="right") - 1
        return np.asarray(self.y_ref[np.maximum(held, 0), index])

    def to_frame(self) -> Any:
        """Return the curves as a pandas DataFrame: time as index, columns "name [unit]".

        Columns are the outputs, states, inputs and signals. `from_frame` reads the
        curves back if you name the inputs.
        """
        import pandas as pd

        columns = {}
        for j, channel in enumerate(self.channels.y):
            values = self.output(j)
            if values is not None:
                columns[channel.label] = values
        for group, values in ((self.channels.x, self.x), (self.channels.u, self.u)):
            # An output that is also a state would be two columns of one name.
            columns |= {c.label: values[:, i] for i, c in enumerate(group) if c.label not in columns}
        columns |= {k: v for k, v in self.signals.items() if k not in columns}
        unit = self.channels.time_unit
        return pd.DataFrame(columns, index=pd.Index(self.t, name=f"time [{unit}]" if unit else "time"))

    def _repr_html_(self) -> str:
        """Return the end, a picture of the curves and a table of the KPIs as HTML, for notebooks."""
        theta = ", ".join(f"{value:.4g}" for value in self.theta)
        rows = list(_with_units(self))
        table = table_of(("KPI", "value"), rows) if rows else ""
        words = (
            f"Experiment: θ = ({theta}), {self.duration:.4g} "
            f"{escape(self.channels.time_unit)}, {escape(self.end.value)}"
        )
        return f"<div><p>{words}</p>{_picture(self)}{table}</div>"

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Experiment):
            return NotImplemented
        # How long a machine took does not make it another experiment: else no run could be repeated.
        names = (f.name for f in fields(self) if f.name != "solve_time")
        return all(_same(getattr(self, n), getattr(other, n)) for n in names)

    __hash__ = None  # type: ignore[assignment]


KPIs = Callable[[Experiment], Mapping[str, float]]  # function of an experiment that returns its KPIs by name
_FAR, _MOSTLY, _RARELY, _NEAR = 0.03, 0.5, 0.1, 1e-6
"""Share of the largest error above which an output is away from its reference, unless its band is narrower;
shares of that time; share of the size of a limit by which an input may miss it and still be at it."""


def limiting_input(experiment: Experiment) -> str:
    """Return the input that is at one limit for most of the time that an output is away from its reference.

    It is "" if none is, and if one goes from limit to limit, which is an oscillation.
    """
    for run in experiment.runs or (experiment,):
        targets = [(c.band or np.inf, run.output(i), run.reference(i)) for i, c in enumerate(run.channels.y)]
        errors = [(b, np.nan_to_num(np.abs(y - r))) for b, y, r in targets if y is not None and r is not None]
        if len(run.t) < 2 or not errors:
            continue
        away = np.any([e[:-1] > min(_FAR * e.max(), band) for band, e in errors], axis=0)
        steps = np.diff(run.t) * away  # values are held until the next instant
        for channel, u in zip(run.channels.u, run.u[:-1].T, strict=True):
            near = _NEAR * max(abs(end) for end in (channel.low, channel.high, 1e-300) if np.isfinite(end))
            ends = [u <= channel.low + near, u >= channel.high - near]
            rarely, mostly = sorted(float(steps[end].sum()) for end in ends)
            if mostly > _MOSTLY * steps.sum() and rarely <= _RARELY * mostly:
                return channel.name
    return ""


_NAMES = ("theta", "t", "x", "u", "t_control", "u_control", "y_ref", "iterations", "solve_time", "solved")
ARRAYS: dict[str, Any] = dict.fromkeys(_NAMES, float) | {"iterations": np.int64, "solved": bool}
"""Types of the arrays of an experiment, by name."""


def _mapping(name: str, value: object) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise ExperimentError(f"{name} must be a mapping from names, got {value!r}")
    return value


def compute(kpis: KPIs, experiment: Experiment) -> Mapping[str, float]:
    """Return `kpis(experiment)`. Raises ExperimentError if it is not a mapping."""
    found: object = kpis(experiment)
    if not isinstance(found, Mapping):
        forgotten = ": is a return missing?" if found is None else ""
        raise ExperimentError(
            f"{getattr(kpis, '__name__', 'kpis')}{place_in_code(kpis)} must return a mapping of KPI names "
            f"to numbers, got {brief(found)}{forgotten}"
        )
    return found


def check_returned(result: object) -> Experiment:
    """Return what a run returned if it is an experiment.

    Raises:
        ScenarioError: If it is not.
    """
    if not isinstance(result, Experiment):
        forgotten = ": is a return missing?" if result is None else ""
        raise ScenarioError(f"run must return an Experiment, got {type(result).__name__}{forgotten}")
    return result


def _checked_kpis(kpis: object) -> FrozenMapping:
    """Check here, where the run is to blame, rather than when the study is saved."""
    found = _mapping("kpis", kpis)
    for name, value in found.items():
        if not isinstance(name, str) or not _is_number(value):
            raise ExperimentError(f"a KPI must be a name and a number, got {name!r}: {value!r}")
    return FrozenMapping(found)


def _is_number(value: object) -> bool:
    if isinstance(value, float):
        return True
    # numpy's numbers, and arrays without a dimension, which libraries return.
    found = np.asarray(value)
    return not found.ndim and found.dtype.kind in "biuf"


def _frozen(values: Any, dtype: Any) -> np.ndarray:
    array = np.array(values, dtype=dtype)
    # A copy was made above, so the caller's array stays writable.
    array.setflags(write=False)
    return array


def _same(a: Any, b: Any) -> bool:
    if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
        # NaN is equal here: a missing reference is the same in both. Only floats can be asked for it.
        return np.array_equal(a, b, equal_nan=a.dtype.kind == "f" and b.dtype.kind == "f")
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        return False
    return bool(a == b)


# --- Hand an experiment to a notebook: as a DataFrame, and as HTML with a picture and its KPIs.


def _with_units(experiment: Experiment) -> Iterable[tuple[str, str]]:
    """Yield the name of each KPI, and its value with its unit if the channels tell that."""
    units = {name: unit for name, unit, _ in kinds_of(experiment.channels)}
    for name, value in experiment.kpis.items():
        # A KPI of one maneuver is called "NAME (MANEUVER)".
        unit = units.get(name, units.get(name.rpartition(" (")[0], ""))
        yield name, f"{value:.4g} {unit}".strip()


def table_of(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return an HTML table of plain texts; all columns but the first one are numbers."""
    head = "".join(f"<th>{escape(heading)}</th>" for heading in headings)
    body = "".join(
        f"<tr><td>{escape(first)}</td>"
        + "".join(f"<td style='text-align:right'>{escape(cell)}</td>" for cell in cells)
        + "</tr>"
        for first, *cells in rows
    )
    return f"<table><tr>{head}</tr>{body}</table>"


def _picture(experiment: Experiment) -> str:
    """Return the curves as an image; nothing without a record or without matplotlib."""
    if not len(experiment.t):
        return ""
    try:
        from matplotlib.figure import Figure
    except ImportError:
        return ""
    channels = experiment.channels
    curves = [
        *((c, experiment.output(j)) for j, c in enumerate(channels.y)),
        *((c, experiment.x[:, i]) for i, c in enumerate(channels.x)),
        *((c, experiment.u[:, i]) for i, c in enumerate(channels.u)),
    ]
    shown = {c.label: (c, values) for c, values in reversed(curves) if values is not None}
    if not shown:
        return ""
    references = {c.label: experiment.y_ref[:, j] for j, c in enumerate(channels.y)}
    rows = np.unique(np.linspace(0, len(experiment.t) - 1, 2000).astype(int))  # points, at most
    figure = Figure(figsize=(6.0, 0.5 + 1.3 * len(shown)), layout="constrained")
    grid = figure.subplots(len(shown), 1, sharex=True, squeeze=False)[:, 0]
    for axes, (channel, values) in zip(grid, reversed(shown.values()), strict=True):
        style = "steps-post" if channel in channels.u else "default"
        axes.plot(experiment.t[rows], values[rows], drawstyle=style, lw=1.2)
        if channel.target is not None:
            axes.axhline(channel.target, color="0.5", ls=":", lw=1)
        elif channel.label in references:
            reference = references[channel.label]
            axes.step(experiment.t_control, reference, where="post", color="0.5", ls=":", lw=1)
        axes.set_title(channel.label, loc="left", fontsize=9)
    grid[-1].set_xlabel(f"time [{experiment.channels.time_unit}]", fontsize=9)
    content = io.BytesIO()
    figure.savefig(content, format="png", dpi=80)
    data = base64.b64encode(content.getvalue()).decode()
    return f"<img alt='curves of the experiment' src='data:image/png;base64,{data}'>"


def instants(t: float, end: float, dense_step: float) -> Float[np.ndarray, " M"]:
    """Return the instants to record: `t`, the multiples of `dense_step` in between, and `end`.

    Multiples that coincide with `t` or `end` are left out, so that no instant appears twice.
    """
    # Multiples of the step from 0 on, so that runs with different T_s share their instants.
    close = 1e-9 * dense_step
    first = floor((t + close) / dense_step) + 1
    last = ceil((end - close) / dense_step)
    return np.array([t, *(k * dense_step for k in range(first, last)), end])


@dataclass(frozen=True, slots=True)
class Record:
    """The record of an episode so far, from which an `Experiment` is made.

    It has K dense instants and N steps, and arrays as in `Experiment`; `end` is None while the
    episode goes on.
    """

    t: Float[np.ndarray, " K"]
    x: Float[np.ndarray, "K n_x"]
    u: Float[np.ndarray, "K n_u"]
    t_control: Float[np.ndarray, " N"]
    u_control: Float[np.ndarray, "N n_u"]
    y_ref: Float[np.ndarray, "N n_y"]
    channels: Channels
    end: End | None
    signals: Mapping[str, Float[np.ndarray, " K"]] = field(default_factory=dict)
    y: Float[np.ndarray, "K n_y"] | None = None


@dataclass(slots=True)
class Trajectory:
    """A collector of the steps of one episode, which starts in `x0` after input `u0`."""

    x0: Float[np.ndarray, " n_x"]
    u0: Float[np.ndarray, " n_u"]
    _t: list[Float[np.ndarray, " M"]] = field(default_factory=list)
    _x: list[Float[np.ndarray, "M n_x"]] = field(default_factory=list)
    _u: list[Float[np.ndarray, " n_u"]] = field(default_factory=list)
    _y_ref: list[Float[np.ndarray, " n_y"]] = field(default_factory=list)

    def add(
        self,
        t: Float[np.ndarray, " M"],
        x: Float[np.ndarray, "M n_x"],
        u: Float[np.ndarray, " n_u"],
        y_ref: Float[np.ndarray, " n_y"],
    ) -> None:
        """Append a period: instants and states after its start, its input and its references."""
        self._t.append(t)
        self._x.append(x)
        self._u.append(u)
        self._y_ref.append(y_ref)

    def record(self, channels: Channels, end: End | None) -> Record:
        """Return everything so far; before the first step, one instant and no step."""
        n_steps = len(self._u)
        t = np.concatenate([np.zeros(1), *self._t])
        lengths = np.array([len(period) for period in self._t], dtype=int)
        starts = np.concatenate([[0], np.cumsum(lengths)])  # index of every period's start in t
        u_control = np.concatenate([np.zeros(0), *self._u]).reshape(n_steps, len(channels.u))
        u = np.repeat(u_control, lengths, axis=0)  # each period's input, until before its end
        last = self._u[-1] if n_steps else self.u0
        return Record(
            t=t,
            x=np.concatenate([self.x0[None], *self._x]),
            u=np.concatenate([u, last[None]]),
            t_control=t[starts[:n_steps]],
            u_control=u_control,
            y_ref=np.concatenate([np.zeros(0), *self._y_ref]).reshape(n_steps, len(channels.y)),
            channels=channels,
            end=end,
        )
