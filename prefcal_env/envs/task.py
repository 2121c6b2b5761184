"""The task of a plant, as data: where an episode starts, what it aims at, and how it ends."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Real

from prefcal_env.arrays import is_number, numbers
from prefcal_env.errors import SettingsError

Values = Sequence[float] | np.ndarray  # the n values of a signal


@dataclass(frozen=True, slots=True)
class StepSignal:
    """A signal that is constant between steps; of a time it is a function, as `Task` takes it."""

    start: Values  # values until the first step, n numbers
    # Later times, increasing, each with the n values from then on
    steps: tuple[tuple[float, Values], ...] = ()

    def __call__(self, t: float) -> Float[np.ndarray, " n"]:
        """Return the values at time `t`, shape (n,)."""
        now = self.start
        for time, values in self.steps:
            # From the step on: a sampling instant at the step already has the new value.
            if t >= time:
                now = values
        return np.asarray(now, dtype=float)

    def over(self, t: Float[np.ndarray, " K"]) -> Float[np.ndarray, "K n"]:
        """Return the values at the times `t`, shape (K, n)."""
        found = np.tile(np.asarray(self.start, dtype=float), (len(t), 1))
        for time, values in self.steps:
            found[t >= time] = values
        return found


def acts_at(when: float, samples: Float[np.ndarray, " N"]) -> float:
    """Return when a change at the time `when` acts: at the first of the samples from there on.

    A sample may lie a rounding error before the change. Without such a sample it is the time itself.
    """
    later = samples[samples >= when * (1 - 1e-9)]
    return float(later[0]) if len(later) else when


Vector = Float[np.ndarray, " _"]
Signal = Vector | Callable[[float], Vector]  # a constant, shape (n,), or a function of time that returns one


@dataclass(frozen=True, slots=True)
class Period:
    """One sampling period, as seen by the rules of a task: M dense instants, with both ends.

    Args:
        t: Dense instants, shape (M,); a period that was cut short ends early.
        x: States at `t`, shape (M, n_x).
        u_before: Input of the previous period, shape (n_u,).
        u: Input held in this period, shape (n_u,).
        y_ref: Output references in this period, shape (n_y,).
        T_s: Sampling time, the length of a complete period.
    """

    t: Float[np.ndarray, " M"]
    x: Float[np.ndarray, "M n_x"]
    u_before: Float[np.ndarray, " n_u"]
    u: Float[np.ndarray, " n_u"]
    y_ref: Float[np.ndarray, " n_y"]
    T_s: float

    @property
    def duration(self) -> float:
        """Duration of this period."""
        return float(self.t[-1] - self.t[0])


def never(_: Any) -> bool:
    """Return False: a rule that never applies."""
    return False


def free(_: Period) -> float:
    """Return 0: a stage cost that charges nothing."""
    return 0.0


@dataclass(frozen=True, eq=False)
class Task:
    """A task for a plant. Times are in the plant's unit of time, values in its channels' units.

    References and disturbances are held over a sampling period at their value at its start.
    Most arguments have a default: x0, u0, y_ref and horizon are enough to tune a controller, which
    has its own sampling time. `T_s`, `T_s_range`, `observed`, `tracked`, `stage_cost` and
    `unsafe_cost` matter only to learned policies.

    Args:
        x0: Initial state, shape (n_x,).
        u0: Input before the start, shape (n_u,).
        y_ref: Output references, shape (n_y,), or a function of time; NaN for an output without
            a reference.
        d: Measured disturbances, shape (n_d,), or a function of time; None if there are none.
        horizon: Duration: the first sample at or after this time is the last one.
        T_s: Default sampling time, which `reset` may override, as a controller does; None is
            1/200 of the horizon.
        T_s_range: Lowest and highest sampling time that `reset` accepts; None is from a millionth
            of the horizon to the whole horizon.
        dense_step: Step of the grid on which the trajectory is recorded, whatever T_s is; None is
            1/500 of the horizon.
        tracked: Indices of the outputs whose reference is observed and drawn; None means all that
            have a reference at the start.
        bands: Accepted distance from the reference by output, for drawing.
        observed: Lowest and highest value of each observed quantity, in the order of the
            observation: states, last input, tracked references, disturbances; shape (n, 2). They
            are scaled to [-1, 1]; beyond them the observation saturates. None uses the limits of
            the channels, or if there are none, ten times the way from the start to the reference
            (see `prefcal_env.envs.plant_env.observed_of`).
        unsafe: Function that returns whether a state, shape (n_x,), ends the episode at once.
        settled: Function that returns whether the episode can end after a step, since nothing
            will change any more.
        stage_cost: Cost of a step per unit of time. The reward is minus this times the duration.
        unsafe_cost: Stage cost charged for the rest of the horizon after an unsafe end, so that
            it never pays to end an episode.
        max_move: Largest change of each input from step to step, shape (n_u,); None for no limit.
        noise: Standard deviation of the noise of each measured output (`Measurement.y`), in the
            output's unit, shape (n_y,); None for no noise. It is white and normal, and follows from
            the seed of `reset` alone.
        bias: What sensors add to each measured output, in the output's unit, shape (n_y,); None for nothing.
        lag: Time constant of the actuators, which no controller is told; 0 for none. Two steps stand for an
            input on its way, so that the plant gets as much of it, and as late, as from a continuous lag; of
            a small move, and on a discrete plant, one, its mean over the period. The record has the input
            that was asked for, within range and rate. Margins are those behind the lag.
        measurement_delay: Dead time of the measurements, one number or one for each output; that of
            the plant's outputs is added.
        jitter: Share of the sampling time, below 0.5, by which a sampling instant is early, or late,
            or neither: each a third of all, drawn from the seed of `reset`. A controller is not told.
        preview: Number of future rows of references and disturbances that a controller gets; 0
            gives only the present values.
        vectorized: Whether `unsafe` also takes M states as columns, shape (n_x, M), and returns an
            array of shape (M,), as in scipy's `solve_ivp`. A period is then checked in one call.

    Raises:
        SettingsError: If a value is no number or not finite, a time is not positive, T_s is outside
            its range, or a row of `observed` does not have low below high.
    """

    x0: Float[np.ndarray, " n_x"]
    u0: Float[np.ndarray, " n_u"]
    y_ref: Signal
    horizon: float
    # None until `__post_init__` derives them from the horizon.
    T_s: float = None  # type: ignore[assignment]
    T_s_range: tuple[float, float] = None  # type: ignore[assignment]
    dense_step: float = None  # type: ignore[assignment]
    observed: Real[np.ndarray, "n 2"] | None = None
    d: Signal | None = None
    tracked: tuple[int, ...] | None = None
    bands: Mapping[int, float] | None = None
    unsafe: Callable[[Vector], Any] = never
    settled: Callable[[Period], bool] = never
    stage_cost: Callable[[Period], float] = free
    unsafe_cost: float = 0.0
    max_move: Float[np.ndarray, " n_u"] | None = None
    noise: Float[np.ndarray, " n_y"] | None = None
    bias: Float[np.ndarray, " n_y"] | None = None
    lag: float = 0.0
    measurement_delay: float | Sequence[float] = 0.0
    jitter: float = 0.0
    preview: int = 0
    vectorized: bool = False

    def __post_init__(self) -> None:
        if self.d is None:
            object.__setattr__(self, "d", np.zeros(0))
        for name in ("x0", "u0", "y_ref", "d", "observed", "max_move", "noise", "bias"):
            value = getattr(self, name)
            if value is None or callable(value):
                continue
            # A copy: the caller's array may change while studies of this task run.
            array = numbers(value, f"task: {name}", SettingsError).copy()
            array.setflags(write=False)
            # NaN means no reference; anywhere else it would be a number that somebody forgot.
            if not np.all(np.isfinite(array) | (np.isnan(array) & (name == "y_ref"))):
                raise SettingsError(f"task: {name} must be finite, got {value!r}")
            object.__setattr__(self, name, array)
        if not is_number(self.horizon):
            raise SettingsError(f"task: horizon must be a number, got {self.horizon!r}")
        # Missing times are shares of the horizon.
        if self.T_s_range is None:
            object.__setattr__(self, "T_s_range", (1e-6 * self.horizon, self.horizon))
        if self.T_s is None:
            low, high = self.T_s_range
            # Clipped: a stated range need not contain this share of the horizon.
            object.__setattr__(self, "T_s", min(max(self.horizon / 200, low), high))
        if self.dense_step is None:
            object.__setattr__(self, "dense_step", self.horizon / 500)
        self._check()

    def _check(self) -> None:
        """Refuse values that cannot be. Raises SettingsError."""
        for name in ("horizon", "dense_step"):
            if not 0 < getattr(self, name) < np.inf:
                raise SettingsError(f"task: {name} must be positive and finite, got {getattr(self, name)}")
        rows = self.observed
        if rows is not None and (rows.ndim != 2 or np.any(rows[:, 0] >= rows[:, 1])):
            raise SettingsError("task: observed must be rows (low, high) with low below high")
        delay = np.asarray(self.measurement_delay)
        if not np.all((delay >= 0) & (delay < np.inf)):
            raise SettingsError(f"task: measurement_delay must be 0 or more and finite, got {delay.tolist()}")
        if not 0 <= self.jitter < 0.5:
            raise SettingsError(f"task: jitter must be at least 0 and below 0.5, got {self.jitter}")
        if not 0 <= self.lag < np.inf:
            raise SettingsError(f"task: lag must be 0 or more and finite, got {self.lag}")
        if self.preview < 0:
            raise SettingsError(f"task: preview must be 0 or more rows, got {self.preview}")
        self.sampling_time(self.T_s)

    def sampling_time(self, T_s: Any) -> float:
        """Return `T_s` as a number. Raises SettingsError if it is no number or out of range."""
        low, high = self.T_s_range
        if not is_number(T_s) or not (0 < low <= T_s <= high):
            raise SettingsError(f"T_s must be a number in [{low}, {high}], above 0, got {T_s!r}")
        return float(T_s)

    def first_unsafe(self, x: Float[np.ndarray, "M n_x"]) -> int | None:
        """Return the index of the first of the states `x` that is unsafe; None if all are safe.

        Raises:
            SettingsError: If `unsafe` is vectorized and returns another shape than (M,).
        """
        if not self.vectorized:
            # One by one, up to the first: people's own rules are written for one state.
            return next((i for i, state in enumerate(x) if self.unsafe(state)), None)
        found = np.asarray(self.unsafe(x.T))
        if found.shape != (len(x),):
            raise SettingsError(
                "task: a vectorized unsafe must return one value for each state, "
                f"shape ({len(x)},), got {found.shape}"
            )
        hits = found.nonzero()[0]
        return int(hits[0]) if len(hits) else None

    def reference(self, t: float) -> Vector:
        """Return the output references at time `t`, shape (n_y,)."""
        return _at(self.y_ref, t)

    def disturbance(self, t: float) -> Vector:
        """Return the measured disturbances at time `t`, shape (n_d,)."""
        assert self.d is not None
        return _at(self.d, t)


def _at(signal: Signal, t: float) -> Vector:
    return np.array(signal(t), dtype=float) if callable(signal) else signal
