"""The record of one closed-loop run of one θ, frozen."""

from collections.abc import Callable, Mapping
from copy import copy
from dataclasses import dataclass, field, fields, replace
from typing import Any, NoReturn, Self

import numpy as np
from jaxtyping import Float, Int

from prefcal_env.errors import ExperimentError, ScenarioError
from prefcal_env.wording import brief, labeled, place_in_code

from .end import End as End


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
        ExperimentError: If `low` is not below `high`.
    """

    name: str
    unit: str = ""
    low: float = -np.inf
    high: float = np.inf
    target: float | None = None
    band: float | None = None
    symbol: str = ""

    def __post_init__(self) -> None:
        if not self.low < self.high:
            raise ExperimentError(
                f"channel {self.name!r}: low must be below high, "
                f"got [{self.low}, {self.high}] {self.unit}".rstrip()
            )

    @property
    def label(self) -> str:
        """Name with unit, for the axis of a plot."""
        return labeled(self.name, self.unit)

    def scaled(self, factor: float, offset: float = 0.0) -> Self:
        """Return the channel with each value v as factor · v + offset, under the same unit."""
        low, high = sorted((factor * self.low + offset, factor * self.high + offset))
        target = None if self.target is None else factor * self.target + offset
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
        for name, dtype in _ARRAYS.items():
            object.__setattr__(self, name, _frozen(getattr(self, name), dtype))
        if self.y is not None:
            object.__setattr__(self, "y", _frozen(self.y, float))
        signals = _mapping("signals", self.signals)
        frozen = FrozenMapping({k: _frozen(v, float) for k, v in signals.items()})
        object.__setattr__(self, "signals", frozen)
        object.__setattr__(self, "kpis", _checked_kpis(self.kpis))
        self._check()

    def _check(self) -> None:
        n_x, n_u, n_y = (len(c) for c in (self.channels.x, self.channels.u, self.channels.y))
        dense, steps = len(np.atleast_1d(self.t)), len(np.atleast_1d(self.t_control))
        expected = {
            "t": (dense,),
            "x": (dense, n_x),
            "u": (dense, n_u),
            "t_control": (steps,),
            "u_control": (steps, n_u),
            "y_ref": (steps, n_y),
            "iterations": (steps,),
            "solve_time": (steps,),
            "solved": (steps,),
        }
        if self.y is not None:
            expected["y"] = (dense, n_y)
        shapes = {name: np.shape(getattr(self, name)) for name in expected}
        expected |= {f"signals[{k!r}]": (dense,) for k in self.signals}
        shapes |= {f"signals[{k!r}]": np.shape(v) for k, v in self.signals.items()}
        for name, shape in expected.items():
            if shapes[name] != shape:
                raise ExperimentError(f"{name} must have shape {shape}, got {shapes[name]}")
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

    def with_kpis(self, kpis: "Mapping[str, float] | KPIs") -> "Experiment":
        """Return this experiment with other KPIs; it shares the arrays, which are checked already.

        Args:
            kpis: KPIs by name, or a function that computes them of this experiment.

        Raises:
            ExperimentError: If `kpis` is not a mapping from names to numbers, or returns none.
        """
        other = copy(self)
        found = computed(kpis, self) if callable(kpis) else kpis
        object.__setattr__(other, "kpis", _checked_kpis(found))
        return other

    @property
    def duration(self) -> float:
        """Time of the last instant, in `channels.time_unit`; 0 without a record."""
        return float(self.t[-1]) if len(self.t) else 0.0

    def at_control(self) -> Float[np.ndarray, "N1 n_x"]:
        """Return the states at the N sampling instants and at the end, shape (N + 1, n_x).

        Without a record the shape is (0, n_x).
        """
        if not len(self.t):
            return self.x
        instants = np.append(self.t_control, self.t[-1])
        nearest = np.searchsorted(self.t, instants - 1e-9 * max(1.0, self.duration))
        return np.asarray(self.x[nearest])

    def output(self, index: int) -> Float[np.ndarray, " K"] | None:
        """Return the output with number `index` (from 0) at `t`, shape (K,).

        If `y` was not recorded, return the state of the same name and unit, or else the signal of
        the same name, or else None.
        """
        if self.y is not None:
            return np.asarray(self.y[:, index])
        channel = self.channels.y[index]
        for i, state in enumerate(self.channels.x):
            if (state.name, state.unit) == (channel.name, channel.unit):
                return np.asarray(self.x[:, i])
        found: Float[np.ndarray, " K"] | None = self.signals.get(channel.name)
        return found

    def reference(self, index: int) -> Float[np.ndarray, " K"]:
        """Return the reference of output `index` (from 0), held from step to step, shape (K,).

        It is NaN where the output has none, and everywhere if no step was recorded.
        """
        if not len(self.t_control):
            return np.full(len(self.t), np.nan)
        held = np.searchsorted(self.t_control, self.t, side="right") - 1
        return np.asarray(self.y_ref[np.maximum(held, 0), index])

    def to_frame(self) -> Any:
        """Return the curves as a pandas DataFrame: time as index, columns "name [unit]".

        Columns are the outputs, states, inputs and signals. `from_frame` reads the
        curves back if you name the inputs.
        """
        from .notebook import frame_of

        return frame_of(self)

    def _repr_html_(self) -> str:
        """Return a picture of the curves and the KPIs, for notebooks."""
        from .notebook import html_of

        return html_of(self)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Experiment):
            return NotImplemented
        names = (f.name for f in fields(self) if f.name != "solve_time")
        return all(_same(getattr(self, n), getattr(other, n)) for n in names)

    __hash__ = None  # type: ignore[assignment]


KPIs = Callable[[Experiment], Mapping[str, float]]
"""Function of an experiment that returns its KPIs by name."""
_ARRAYS: dict[str, Any] = {
    "theta": float,
    "t": float,
    "x": float,
    "u": float,
    "t_control": float,
    "u_control": float,
    "y_ref": float,
    "iterations": np.int64,
    "solve_time": float,
    "solved": bool,
}


def _mapping(name: str, value: object) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise ExperimentError(f"{name} must be a mapping from names, got {value!r}")
    return value


def computed(kpis: KPIs, experiment: Experiment) -> Mapping[str, float]:
    """Return `kpis(experiment)`. Raises ExperimentError if it is not a mapping."""
    found: object = kpis(experiment)
    if not isinstance(found, Mapping):
        forgotten = ": is a return missing?" if found is None else ""
        raise ExperimentError(
            f"{getattr(kpis, '__name__', 'kpis')}{place_in_code(kpis)} must return a mapping of KPI names "
            f"to numbers, got {brief(found)}{forgotten}"
        )
    return found


def returned(result: object) -> Experiment:
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
    found = np.asarray(value)
    return not found.ndim and found.dtype.kind in "biuf"


def _frozen(values: Any, dtype: Any) -> np.ndarray:
    array = np.array(values, dtype=dtype)
    array.setflags(write=False)
    return array


def _same(a: Any, b: Any) -> bool:
    if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
        return np.array_equal(a, b, equal_nan=a.dtype.kind == "f" and b.dtype.kind == "f")
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        return False
    return bool(a == b)
