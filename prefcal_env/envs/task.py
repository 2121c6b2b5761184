"""What is asked of a plant: where an episode starts, what it aims at and how it ends, as data."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Real

from prefcal_env.errors import SettingsError

Vector = Float[np.ndarray, " _"]
Signal = Vector | Callable[[float], Vector]
"""A constant, shape (n,), or a function of time that returns one."""


@dataclass(frozen=True, slots=True)
class Step:
    """One sampling period, as the rules of a task see it: M dense instants, both ends included.

    Args:
        t: Dense instants, shape (M,); a period that was cut short ends early.
        x: States there, shape (M, n_x).
        u_before: Input of the period before, shape (n_u,).
        u: Input held in this period, shape (n_u,).
        y_ref: Output references in this period, shape (n_y,).
        T_s: Sampling time, the length of a whole period.
    """

    t: Float[np.ndarray, " M"]
    x: Float[np.ndarray, "M n_x"]
    u_before: Float[np.ndarray, " n_u"]
    u: Float[np.ndarray, " n_u"]
    y_ref: Float[np.ndarray, " n_y"]
    T_s: float

    @property
    def duration(self) -> float:
        """Time that this period lasted."""
        return float(self.t[-1] - self.t[0])


def never(_: Any) -> bool:
    """The rule that never applies."""
    return False


def free(_: Step) -> float:
    """The stage cost that is always 0."""
    return 0.0


@dataclass(frozen=True, eq=False)
class Task:
    """One task for a plant. Times in the plant's unit of time, values in its channels' units.

    References and disturbances are held over a sampling period at their value at its start.
    Most of it has a default: x0, u0, y_ref and horizon are enough to tune a controller, which
    brings its own sampling time. What is observed matters to learned policies only.

    Args:
        x0: State at the start, shape (n_x,).
        u0: Input before the start, shape (n_u,).
        y_ref: Output references, shape (n_y,), or a function of time; NaN for an output that has
            none.
        d: Measured disturbances, shape (n_d,), or a function of time; None: there are none.
        horizon: The first sample at or after this time is the last one.
        T_s: Sampling time, unless `reset` is told another one, as a controller does; None: a
            200th of the horizon.
        T_s_range: Lowest and highest sampling time that `reset` accepts; None: from a millionth
            of the horizon to all of it.
        dense_step: Step of the grid on which the trajectory is recorded, whatever T_s is; None: a
            500th of the horizon.
        tracked: The outputs whose reference matters: those that are observed and drawn; None:
            all that have a reference at the start.
        bands: Accepted distance from the reference by output, for drawing.
        observed: Lowest and highest value of everything observed, in the order of the
            observation: states, last input, tracked references, disturbances; shape (n, 2).
            They are scaled to [-1, 1]; beyond them the observation saturates. None: the limits
            of the channels, or where there are none ten times the way from the start to the
            reference (see `prefcal_env.envs.fit.observed_of`).
        unsafe: Whether a state, shape (n_x,), ends the episode at once.
        settled: Whether the episode is over at the end of a step, nothing being left to see.
        stage_cost: Of a step, per unit of time; minus this times its duration is the reward.
        unsafe_cost: Stage cost that is charged for the rest of the horizon after an unsafe end,
            so that it never pays to end an episode.
        max_move: Largest change of each input from step to step, shape (n_u,); None is any.
        preview: Rows of references and disturbances that a controller gets ahead; 0: only now's.

    Raises:
        SettingsError: times that are not positive, a T_s outside its range, values that are not
            finite, an `observed` that is not rows of low below high.
    """

    x0: Float[np.ndarray, " n_x"]
    u0: Float[np.ndarray, " n_u"]
    y_ref: Signal
    horizon: float
    # None until `__post_init__` has derived them from the horizon.
    T_s: float = None  # type: ignore[assignment]
    T_s_range: tuple[float, float] = None  # type: ignore[assignment]
    dense_step: float = None  # type: ignore[assignment]
    observed: Real[np.ndarray, "n 2"] | None = None
    d: Signal | None = None
    tracked: tuple[int, ...] | None = None
    bands: Mapping[int, float] | None = None
    unsafe: Callable[[Vector], bool] = never
    settled: Callable[[Step], bool] = never
    stage_cost: Callable[[Step], float] = free
    unsafe_cost: float = 0.0
    max_move: Float[np.ndarray, " n_u"] | None = None
    preview: int = 0

    def __post_init__(self) -> None:
        if self.d is None:
            object.__setattr__(self, "d", np.zeros(0))
        for name in ("x0", "u0", "y_ref", "d", "observed", "max_move"):
            value = getattr(self, name)
            if value is None or callable(value):
                continue
            array = np.array(value, dtype=float)
            array.setflags(write=False)
            if not np.all(np.isfinite(array) | (np.isnan(array) & (name == "y_ref"))):
                raise SettingsError(f"task: {name} must be finite, got {value!r}")
            object.__setattr__(self, name, array)
        self._derive()
        for name in ("horizon", "dense_step"):
            if not 0 < getattr(self, name) < np.inf:
                raise SettingsError(
                    f"task: {name} must be positive and finite, got {getattr(self, name)}"
                )
        rows = self.observed
        if rows is not None and (rows.ndim != 2 or np.any(rows[:, 0] >= rows[:, 1])):
            raise SettingsError("task: observed must be rows (low, high) with low below high")
        if self.preview < 0:
            raise SettingsError(f"task: preview must be 0 or more rows, got {self.preview}")
        self.sampling_time(self.T_s)

    def _derive(self) -> None:
        """Fill in the times that were left out, as shares of the horizon."""
        if self.T_s_range is None:
            object.__setattr__(self, "T_s_range", (1e-6 * self.horizon, self.horizon))
        if self.T_s is None:
            low, high = self.T_s_range
            object.__setattr__(self, "T_s", min(max(self.horizon / 200, low), high))
        if self.dense_step is None:
            object.__setattr__(self, "dense_step", self.horizon / 500)

    def sampling_time(self, T_s: Any) -> float:
        """Return `T_s` as a number. Raises SettingsError if it is none, or out of range."""
        low, high = self.T_s_range
        if not _is_number(T_s) or not (0 < low <= T_s <= high):
            raise SettingsError(f"T_s must be a number in [{low}, {high}], above 0, got {T_s!r}")
        return float(T_s)

    def reference(self, t: float) -> Vector:
        """Output references at time `t`, shape (n_y,)."""
        return _at(self.y_ref, t)

    def disturbance(self, t: float) -> Vector:
        """Measured disturbances at time `t`, shape (n_d,)."""
        assert self.d is not None
        return _at(self.d, t)


def _at(signal: Signal, t: float) -> Vector:
    return np.array(signal(t), dtype=float) if callable(signal) else signal


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool)
