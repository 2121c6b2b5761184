"""A plant and a task as a Gymnasium environment: one step is one sampling period."""

from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property, partial
from itertools import pairwise
from math import exp, expm1, isfinite
from typing import Any

import gymnasium as gym
import numpy as np
from jaxtyping import Float

from prefcal_env.arrays import known_options, plant_vector
from prefcal_env.errors import PlantError, ProtocolError, SettingsError
from prefcal_env.experiments.experiment import (
    Channel,
    Channels,
    End,
    Measurement,
    Record,
    Trajectory,
    instants,
)
from prefcal_env.plants.jacobians import D, States, Times, U, X
from prefcal_env.plants.plant import Plant

from .canvas import Canvas, DrawnCurve, check_render_mode
from .task import Period, Task

# --- Check that a plant fits a task, and derive the properties of the combination.


def channels_of(plant: Plant, task: Task) -> Channels:
    """Return the plant's channels; a constant reference becomes the target of its output."""
    outputs = list(plant.outputs)
    if not callable(task.y_ref):
        for i in tracked_of(task):
            band = (task.bands or {}).get(i)
            outputs[i] = replace(outputs[i], target=float(task.reference(0.0)[i]), band=band)
    return Channels(plant.states, plant.inputs, tuple(outputs), plant.time_unit)


def tracked_of(task: Task) -> tuple[int, ...]:
    """Return the indices of tracked outputs: by default, all outputs with a reference."""
    if task.tracked is not None:
        return task.tracked
    return tuple(map(int, np.flatnonzero(np.isfinite(task.reference(0.0)))))


def observed_of(plant: Plant, task: Task) -> Float[np.ndarray, "n 2"]:
    """Return the lowest and highest value of each observed quantity, shape (n, 2), as in `Task`.

    A channel without a limit extends ten times the distance between its start and its reference,
    or its start and 0; ten units if these are all 0.
    """
    if task.observed is not None:
        return task.observed
    reference, d = task.reference(0.0), task.disturbance(0.0)
    aims = {
        (channel.name, channel.unit): reference[i]
        for i, channel in enumerate(plant.outputs)
        if i in tracked_of(task)
    }
    rows = [
        _reach(channel, start, aims.get((channel.name, channel.unit), start))
        for channel, start in zip(plant.states, task.x0, strict=True)
    ]
    rows += [_reach(c, start, start) for c, start in zip(plant.inputs, task.u0, strict=True)]
    rows += [_reach(plant.outputs[i], reference[i], 0.0) for i in tracked_of(task)]
    rows += [_reach(c, start, start) for c, start in zip(plant.disturbances, d, strict=True)]
    return np.array(rows, dtype=float)


def _reach(channel: Channel, start: float, aim: float) -> tuple[float, float]:
    """Return the limits of a channel, with a guess for each missing one."""
    # 0 if the channel starts and stays at 0, and then nothing says how large its values are.
    reach = 10 * max(abs(start), abs(aim - start)) or 10.0
    low = channel.low if np.isfinite(channel.low) else min(start, channel.high) - reach
    high = channel.high if np.isfinite(channel.high) else max(start, channel.low) + reach
    return low, high


def check_fit(plant: Plant, task: Task) -> None:
    """Raise SettingsError if shapes, ranges or limits of plant and task do not fit."""
    parts = ("f", "g", "hold", "states", "inputs", "outputs", "disturbances")
    if not isinstance(task, Task) or not all(hasattr(plant, part) for part in parts):
        raise SettingsError(f"needs a plant and a Task, got {plant!r:.60} and {task!r:.60}")
    n_x, n_u, n_y, n_d = map(len, (plant.states, plant.inputs, plant.outputs, plant.disturbances))
    tracked = tracked_of(task)
    n_o = n_x + n_u + len(tracked) + n_d
    values: dict[str, tuple[np.ndarray, tuple[int, ...]]] = {
        "x0": (task.x0, (n_x,)),
        "u0": (task.u0, (n_u,)),
        "y_ref": (task.reference(0.0), (n_y,)),
        "d": (task.disturbance(0.0), (n_d,)),
    }
    if task.observed is not None:
        values["observed"] = (task.observed, (n_o, 2))
    for name, (value, shape) in values.items():
        if value.shape != shape:
            raise SettingsError(
                f"task: {name} must have shape {shape} for plant {plant.name!r}, got {value.shape}"
            )
    if task.noise is not None and (task.noise.shape != (n_y,) or np.any(task.noise < 0)):
        raise SettingsError(f"task: noise must be {n_y} standard deviations of 0 or more, got {task.noise}")
    if task.bias is not None and task.bias.shape != (n_y,):
        raise SettingsError(f"task: bias must be {n_y} numbers, got {task.bias}")
    if np.shape(task.measurement_delay) not in ((), (n_y,)):
        raise SettingsError(
            f"task: measurement_delay must be one number or {n_y}, got {task.measurement_delay}"
        )
    if any(not 0 <= i < n_y or np.isnan(task.reference(0.0)[i]) for i in tracked):
        raise SettingsError(
            f"task: tracked must be outputs 0 to {n_y - 1} that have a reference, got {tracked}"
        )
    if task.max_move is not None and (task.max_move.shape != (n_u,) or np.any(task.max_move <= 0)):
        raise SettingsError(f"task: max_move must be {n_u} positive numbers, got {task.max_move}")


def check_limits(plant: Plant) -> None:
    """Raise SettingsError if an input has no limits, which actions are scaled by."""
    for i, channel in enumerate(plant.inputs):
        if not np.isfinite([channel.low, channel.high]).all():
            raise SettingsError(
                f"input {i} ({channel.name!r}) needs finite limits to scale actions by, "
                f"got [{channel.low}, {channel.high}] {channel.unit}".rstrip()
            )


def check_rate(plant: Plant, x: X, u: U, d: Float[np.ndarray, "*n_d"]) -> None:
    """Raise PlantError if f is NaN at the start of an experiment, which no θ can mend.

    Anything else that is not finite is data: an unstable run that blows up.
    """
    now = d if d.ndim == 1 else d[0]
    with np.errstate(all="ignore"):
        rate = plant.f(x, u, now)
    # If what f was given is not finite, the mistake was made before.
    if not np.isnan(rate).any() or not np.isfinite([*x, *u, *now]).all():
        return
    which = [channel.name for channel, v in zip(plant.states, rate, strict=True) if np.isnan(v)]
    at = "".join(f", {name} = {v.tolist()}" for name, v in (("u", u), ("d", now)) if len(v))
    raise PlantError(
        f"plant {plant.name!r}: f must be finite at the start of an experiment, got NaN for "
        f"{which} at x = {x.tolist()}{at}"
    )


# --- Dead time of inputs, outputs and measurements, exact for any length and sampling time.


def delays_of(plant: Plant) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return the dead times of inputs and outputs in the plant's unit of time; 0 if it has none."""
    inputs, outputs = getattr(plant, "input_delay", ()), getattr(plant, "output_delay", ())
    return tuple(inputs) or (0.0,) * len(plant.inputs), tuple(outputs) or (0.0,) * len(plant.outputs)


def dead_times(plant: Plant) -> Float[np.ndarray, "n_y n_u"]:
    """Return the dead time from each input to each output, in the plant's unit of time."""
    inputs, outputs = delays_of(plant)
    entries = getattr(plant, "entry_delay", ()) or 0.0
    return np.asarray(np.add.outer(outputs, inputs) + np.array(entries))


def piecewise(
    hold: Callable[[X, float, Times], States], x: X, t: Times, cuts: Sequence[float]
) -> Float[np.ndarray, "M1 n_x"]:
    """Return the states at `t[1:]`, where `hold(x, start, instants)` begins anew at each cut."""
    if not cuts:
        return hold(x, float(t[0]), t[1:])
    rows: list[np.ndarray] = []
    for a, b in pairwise([float(t[0]), *cuts, float(t[-1])]):
        inside = t[(t > a) & (t <= b)]
        # The state is needed where an input changes, also if nothing is recorded there.
        instants = inside if len(inside) and inside[-1] == b else np.append(inside, b)
        states = hold(x, a, instants)
        rows.append(states[: len(inside)])
        x = states[-1]
    return np.concatenate(rows)


class DeadTime:
    """The part of an episode that a plant with dead time remembers.

    A sampling period is divided where a delayed input changes, so that dead times need not be
    multiples of the sampling time. Before the start, the plant is at its initial state and input.
    """

    def __init__(self, plant: Plant, x0: X, u0: U, d0: D) -> None:
        self._plant, self._delays = plant, delays_of(plant)[0]
        self._distinct = sorted(set(self._delays))
        self._given_at, self._given = [-np.inf], [u0]  # inputs as they are decided
        self._since, self._spans = [-np.inf], [(x0, u0, d0)]  # as they reach the plant
        self._tolerance = 0.0
        self._end = -np.inf, x0  # the latest state
        entries = getattr(plant, "entry_delay", ())
        self._entries = np.pad(entries, ((0, 0), (0, 1))) if entries else None

    def hold(self, x: X, u: U, d: D, t: Float[np.ndarray, " M"]) -> Float[np.ndarray, "M1 n_x"]:
        """Decide u at `t[0]` and hold it until `t[-1]`; return the states at `t[1:]`."""
        start, end = float(t[0]), float(t[-1])
        self._tolerance = 1e-10 * (end - start)  # instants that are closer count as one
        self._given_at.append(start)
        self._given.append(u)
        return piecewise(
            lambda x, a, instants: self._held(x, d, a, instants), x, t, self._changes(start, end)
        )

    def _held(self, x: X, d: D, start: float, t: Float[np.ndarray, " M"]) -> Float[np.ndarray, "M n_x"]:
        """Return the states at `t` after x at `start`; no delayed input changes meanwhile."""
        reaching = self._reaching(start)
        self._since.append(start)
        self._spans.append((x, reaching, d))
        # After a blow-up there is nothing to simulate, but the period still has its rows.
        if all(map(isfinite, x.tolist())):
            states = self._plant.hold(x, reaching, d, t - start)
        else:
            states = np.full((len(t), len(x)), np.nan)
        self._end = float(t[-1]), states[-1]
        return states

    def outputs(self, t: float, delays: tuple[float, ...]) -> Float[np.ndarray, " n_y"]:
        """Return the outputs as seen at `t`, each from as long ago as its delay, shape (n_y,)."""
        if self._entries is not None:
            return self._join(t, self._entries + np.array(delays)[:, None])
        if len(delays) == 1:
            return np.array(self._output(t - delays[0]))
        seen = {delay: self._output(t - delay) for delay in set(delays)}
        return np.array([seen[delay][i] for i, delay in enumerate(delays)], dtype=float)

    def _join(self, t: float, ago: Float[np.ndarray, "n_y n"]) -> Float[np.ndarray, " n_y"]:
        """Return the sums of what each input adds to the outputs, from as long ago as `ago`."""
        y = np.zeros(len(ago))
        for delay in np.unique(ago).tolist():
            entries = self._output(t - delay, self._plant.entries)  # type: ignore[attr-defined]
            y += np.where(ago == delay, entries, 0.0).sum(axis=1)
        return y

    def _changes(self, start: float, end: float) -> list[float]:
        """Return the instants between `start` and `end` at which a delayed input changes."""
        first, last = start + self._tolerance, end - self._tolerance
        found: list[float] = []
        for delay in self._distinct:
            # Inputs are in order of time, so an episode of many periods is not searched from its start.
            begin = bisect_right(self._given_at, first - delay)
            for given in self._given_at[max(begin, 1) :]:
                if (t := given + delay) >= last:
                    break
                if t > first:
                    found.append(t)
        merged: list[float] = []
        for t in sorted(found):
            # Two inputs may change at the same instant but for rounding, and no interval is that short.
            if not merged or t - merged[-1] > self._tolerance:
                merged.append(t)
        return merged

    def _reaching(self, t: float) -> Float[np.ndarray, " n_u"]:
        """Return the inputs that act on the plant from `t` on, shape (n_u,)."""
        last = [bisect_right(self._given_at, t - delay + self._tolerance) - 1 for delay in self._delays]
        return np.array([self._given[k][i] for i, k in enumerate(last)], dtype=float)

    def _output(self, t: float, g: Callable[..., Any] | None = None) -> np.ndarray:
        """Return the outputs of the plant at `t`, or what `g` makes of its state."""
        k = bisect_right(self._since, t + self._tolerance) - 1
        x, u, d = self._spans[k]
        ago = t - self._since[k]
        if k == len(self._since) - 1 and abs(t - self._end[0]) <= self._tolerance:
            x = self._end[1]
        elif self._tolerance < ago < np.inf:
            x = self._plant.hold(x, u, d, np.array([ago]))[0]
        return np.asarray((g or self._plant.g)(x, u, d), dtype=float)


Array = np.ndarray[Any, Any]
STRAIGHT, SUDDEN, LITTLE = 0.03, 1e8, 0.02
"""Lengths of a period in lags beyond which the mean will do, since moments of the decay, or its end, are lost
in rounding; and share of the largest move so far up to which it does: two steps take twice as long."""


def _two_steps(r: float) -> tuple[float, float, float]:
    """Return what stands for e^(-r t) from 0 to 1: its first value, until when, and its second value.

    The integrals of both are the same, also those of t and of t² times them: a plant gets as much, and in
    the mean as late. Both values are between 0 and 1.
    """
    left = exp(-r)
    m0, m1, m2 = (1 - left) / r, (1 - (1 + r) * left) / r**2, (2 - (2 + 2 * r + r * r) * left) / r**3
    second = (3 * m2 * m0 - 4 * m1 * m1) / (m0 - 4 * m1 + 3 * m2)
    until = (2 * m1 - second) / (m0 - second)
    return second + (m0 - second) / until, until, second


class PlantEnv(gym.Env[Array, Array]):
    """An environment in which a controller or a learned policy controls `plant` to do `task`.

    - Action, float, shape (n_u,): the plant's inputs, scaled so that [-1, 1] is the range between
      their limits. Beyond the limits they saturate, as actuators do.
    - Observation, float32, shape (n,): states, last input, tracked references and measured
      disturbances, each scaled to [-1, 1] by `task.observed` and clipped.
    - Reward: minus `task.stage_cost` times the duration of the step.
    - terminated: unsafe, or a state that is not finite. truncated: time is up, or settled.
    - Info: `t`, `x` and `u` (the applied input) in the plant's units; `end` at the end.
    - Options of `reset`: `T_s` and `x0`, in the plant's units.

    The dead time of a plant (`Plant.of(..., delay=...)`) acts on inputs and recorded outputs.
    Nothing is random except the noise of `task.noise`, which follows from the seed.

    Args:
        plant: Plant to control.
        task: Task to do.
        render_mode: None or "rgb_array".
        outputs_are_states: Whether y = x at any time. `plant.g` is then not called to record y.

    Raises:
        SettingsError: If the task does not fit the plant or the render mode is unknown; when
            `action_space` or `step` is used, if an input has no limits to scale actions by.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 10}  # noqa: RUF012
    signals: tuple[str, ...] = ()
    """Additional signals of its experiments beside states, inputs and outputs: none."""

    def __init__(
        self, plant: Plant, task: Task, render_mode: str | None = None, *, outputs_are_states: bool = False
    ) -> None:
        check_fit(plant, task)
        check_render_mode(render_mode, self.metadata)
        self.plant, self.task, self.render_mode = plant, task, render_mode
        self.channels = channels_of(plant, task)
        self._low = np.array([c.low for c in plant.inputs])
        self._high = np.array([c.high for c in plant.inputs])
        self.outputs_are_states = outputs_are_states
        self._tracked, self._observed = tracked_of(task), observed_of(plant, task)
        panels = len(self._tracked) + len(plant.inputs)
        self._canvas = Canvas(plant.name, f"time [{plant.time_unit}]", panels)
        self._episode: Trajectory | None = None
        self._farthest = np.zeros(len(plant.inputs))
        self._held: list[U] = []  # what acted in each period: the record has what was asked for
        self._end: End | None = None
        self._T_s, self._steps = task.T_s, 0
        self._t, self._x, self._u, self._reached = 0.0, task.x0, task.u0, task.u0
        self._output_delay = delays_of(plant)[1]
        measuring = np.broadcast_to(task.measurement_delay, len(plant.outputs)).tolist()
        self._seen_delay = tuple(map(sum, zip(self._output_delay, measuring, strict=True)))
        self._delayed = bool(dead_times(plant).any()) or any(self._seen_delay)
        self._dead_time: DeadTime | None = None
        self._noise = np.zeros(len(plant.outputs))

    # Spaces are made when they are first used: a rollout needs none, and they take a while.
    @cached_property
    def action_space(self) -> gym.spaces.Space[Array]:  # type: ignore[override]
        """Space of the actions. Raises SettingsError if an input has no limits."""
        check_limits(self.plant)
        return gym.spaces.Box(-1.0, 1.0, (len(self._low),), np.float32)

    @cached_property
    def observation_space(self) -> gym.spaces.Space[Array]:  # type: ignore[override]
        """Space of the observations."""
        return gym.spaces.Box(-1.0, 1.0, (len(self._observed),), np.float32)

    @property
    def T_s(self) -> float:
        """Sampling time of this episode, in the plant's unit of time."""
        return self._T_s

    @property
    def end(self) -> End | None:
        """Why the episode ended; None before the first episode and while one goes on."""
        return self._end

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Start an episode; options `T_s` and `x0`, shape (n_x,), in the plant's units.

        Raises:
            SettingsError: If an option is unknown, or the sampling time is out of range or no
                multiple of that of a discrete plant.
            PlantError: If the initial state has the wrong shape, is not finite, or is unsafe.
        """
        super().reset(seed=seed)
        options = known_options(options, ("T_s", "x0"))
        T_s = self.sampling_time(options.get("T_s", self.task.T_s))
        x0 = plant_vector(options.get("x0", self.task.x0), len(self.plant.states), "initial state x0")
        if self.task.unsafe(x0):
            raise PlantError(f"the initial state x0 is unsafe: {x0}")
        self._T_s, self._steps, self._end = T_s, 0, None
        self._t, self._x, self._u, self._reached = 0.0, x0, self.task.u0, self.task.u0
        self._episode, self._held, self._farthest = Trajectory(x0, self.task.u0), [], np.zeros(len(self._low))
        if self._delayed:
            self._dead_time = DeadTime(self.plant, x0, self.task.u0, self.task.disturbance(0.0))
        self._draw_noise()
        return self.observe(), self._info()

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Apply `action`, shape (n_u,), inputs scaled to [-1, 1], for one sampling period.

        Raises:
            PlantError: If the action has the wrong shape or is not finite.
            ProtocolError: If no episode is running.
        """
        step = self.apply(self.inputs(action))
        reward = -self.task.stage_cost(step) * step.duration
        terminated = self._end is End.UNSAFE
        if terminated:
            # For the whole rest of the time: ending early must not be cheaper than going on.
            reward -= self.task.unsafe_cost * max(self.task.horizon - self._t, 0.0)
        truncated = self._end is not None and not terminated
        return self.observe(), float(reward), terminated, truncated, self._info()

    def inputs(self, action: Array) -> Float[np.ndarray, " n_u"]:
        """Return the inputs that `action` stands for, both shape (n_u,), in the plant's units.

        Raises:
            PlantError: If the action has the wrong shape or is not finite.
            SettingsError: If an input has no limits.
        """
        check_limits(self.plant)
        a = plant_vector(action, len(self._low), "action")
        return np.asarray(self._low + (a + 1) / 2 * (self._high - self._low))

    def apply(self, u: Float[np.ndarray, " n_u"]) -> Period:
        """Hold the inputs `u`, shape (n_u,), in the plant's units, for one sampling period.

        They saturate at the plant's limits (and at the task's largest move, if it has one).

        Raises:
            PlantError: If the inputs have the wrong shape or are NaN, or the plant's equations are
                NaN at the start.
            ProtocolError: If no episode is running.
        """
        if self._episode is None or self._end is not None:
            raise ProtocolError("no episode is running: call reset() first")
        u = self._saturate(plant_vector(u, len(self._low), "input u", finite=False))
        y_ref, d = self.task.reference(self._t), self.task.disturbance(self._t)
        self._steps += 1
        # Nothing is drawn without jitter, so that its absence leaves the noise of a seed as it was.
        late = self.task.jitter * int(self.np_random.integers(-1, 2)) if self.task.jitter else 0.0
        t = instants(self._t, (self._steps + late) * self._T_s, self.task.dense_step)
        held, parts = self._move_actuators(u, t)
        later = piecewise(partial(self._hold, parts, d), self._x, t, [start for start, _ in parts[1:]])
        x = np.concatenate([self._x[None], later])
        kept, stopped = self._survived(x)
        if stopped:
            # Only the start is left of the first period: f itself may be NaN there.
            if kept == self._steps == 1:
                check_rate(self.plant, self._x, u, d)
            t, x = t[:kept], x[:kept]
        self._episode.add(t[1:], x[1:], u, y_ref)
        self._held.append(held)
        step = Period(t, x, u_before=self._u, u=u, y_ref=y_ref, T_s=self._T_s)
        self._t, self._x, self._u = float(t[-1]), x[-1], u
        self._draw_noise()
        if stopped:
            self._end = End.UNSAFE
        elif self.task.settled(step):
            self._end = End.SETTLED
        # Rounding may leave the last instant just below the horizon.
        elif self._t >= self.task.horizon * (1 - 1e-12):
            self._end = End.TIME_UP
        return step

    def observe(self) -> Array:
        """Return the current observation, as `reset` and `step` do, shape (n,), float32."""
        tracked, t = self.task.reference(self._t)[list(self._tracked)], self._t
        raw = np.concatenate([self._x, self._u, tracked, self.task.disturbance(t)])
        low, high = self._observed.T
        scaled: Array = 2 * (raw - low) / (high - low) - 1
        return scaled.clip(-1, 1).astype(np.float32)

    def measurement(self) -> Measurement:
        """Return what a controller knows at this sampling instant."""
        if self.task.preview:
            ahead = self._t + self._T_s * np.arange(self.task.preview + 1)
            y_ref = np.array([self.task.reference(t) for t in ahead[1:]])
            d = np.array([self.task.disturbance(t) for t in ahead[:-1]])
        else:
            y_ref, d = self.task.reference(self._t), self.task.disturbance(self._t)
        x = self._x.view()  # of the plant itself: a controller that changes it in place would move the plant
        x.flags.writeable = False
        return Measurement(self._t, x, self._u, d, y_ref, self._measured(d) + self._noise)

    def record(self) -> Record:
        """Return the current or last episode. Raises ProtocolError if there is none.

        Outputs at each instant are computed with the input that is held from there on.
        """
        if self._episode is None:
            raise ProtocolError("no episode to record: call reset() first")
        record = self._episode.record(self.channels, self._end)
        return replace(record, y=self._outputs(record))

    def _outputs(self, record: Record) -> Float[np.ndarray, "K n_y"]:
        """Return y = g(x, u, d) at every instant, with d held as it acted on the plant."""
        if self._dead_time is not None:
            return np.array([self._dead_time.outputs(t, self._output_delay) for t in record.t])
        if self.outputs_are_states:
            return record.x.copy()
        # At a sampling instant, the disturbance that is held from there on.
        held = np.searchsorted(record.t_control, record.t, side="right") - 1
        sampled = record.t_control if len(record.t_control) else record.t
        d = [self.task.disturbance(t) for t in sampled.tolist()]
        acted = self._held or [self.task.u0]
        rows = zip(record.x, np.maximum(held, 0).tolist(), strict=True)
        y = [self.plant.g(x, acted[k], d[k]) for x, k in rows]
        return np.array(y, dtype=float).reshape(len(record.t), len(self.plant.outputs))

    def render(self) -> Array | None:
        """Return an image of the episode so far, (height, width, 3) uint8, or None."""
        if self.render_mode is None:
            return None
        state = "" if self._end is None else f", {self._end.value}"
        note = f"{self._t:.4g} {self.plant.time_unit}{state}"
        return self._canvas.frame(self._curves(), note)

    def close(self) -> None:
        """Release the figure."""
        self._canvas.close()

    def _measured(self, d: Float[np.ndarray, "*d"]) -> Float[np.ndarray, " n_y"]:
        """Return the outputs as measured now, without noise, with the last input."""
        if self._dead_time is not None:
            return self._dead_time.outputs(self._t, self._seen_delay)
        if self.outputs_are_states:
            return self._x
        now = d if d.ndim == 1 else d[0]
        return np.asarray(self.plant.g(self._x, self._reached, now), dtype=float)

    def _draw_noise(self) -> None:
        """Draw the noise of the next measurement: once a step, however often it is read."""
        if self.task.noise is not None:
            self._noise = self.task.noise * self.np_random.standard_normal(len(self._noise))
        if self.task.bias is not None:
            noise = 0.0 if self.task.noise is None else self._noise
            self._noise = self.task.bias + noise

    def sampling_time(self, T_s: Any) -> float:
        """Return `T_s` as a number. Raises SettingsError if it is out of range, or does not fit the plant."""
        found, dt = self.task.sampling_time(T_s), getattr(self.plant, "sample_time", 0.0)
        steps = found / dt if dt else 1.0
        if abs(steps - round(steps)) > 1e-6 or round(steps) < 1:
            raise SettingsError(
                f"the controller's T_s must be a multiple of the sample time {dt:g} "
                f"{self.plant.time_unit} of plant {self.plant.name!r}, got {found:g}"
            )
        return found

    def _hold(
        self, parts: Sequence[tuple[float, U]], d: D, x: X, start: float, after: Times
    ) -> Float[np.ndarray, "M n_x"]:
        """Return the states at `after` from x at `start`, with what acts from then on held."""
        acting = parts[-1][1] if start >= parts[-1][0] else parts[0][1]
        if self._dead_time is None:
            return self.plant.hold(x, acting, d, after - start)
        return self._dead_time.hold(x, acting, d, np.concatenate([[start], after]))

    def _move_actuators(self, u: U, t: Times) -> tuple[U, list[tuple[float, U]]]:
        """Move the actuators towards `u` over a period.

        Return the mean of the inputs on their way, and what stands for them from when on; each shape (n_u,).
        """
        missing, self._reached = self._reached - u, u
        if not self.task.lag:
            return u, [(self._t, u)]
        duration = float(t[-1] - t[0])
        share = duration / self.task.lag
        self._reached, mean = u + missing * exp(-share), u - missing * expm1(-share) / share
        self._farthest = np.maximum(self._farthest, np.abs(missing))
        little = bool(np.all(np.abs(missing) <= LITTLE * self._farthest))
        discrete = getattr(self.plant, "sample_time", 0.0) > 0  # it sees nothing between its samples
        if little or discrete or not STRAIGHT < share < SUDDEN:
            return mean, [(self._t, mean)]
        first, until, second = _two_steps(share)
        steps = [(self._t, u + missing * first), (self._t + until * duration, u + missing * second)]
        return mean, steps

    def _saturate(self, u: Array) -> Array:
        low, high, move = self._low, self._high, self.task.max_move
        # The largest move is from the input that acted, not from the one that was asked for.
        if move is not None:
            low, high = np.maximum(low, self._u - move), np.minimum(high, self._u + move)
        return np.asarray(np.minimum(np.maximum(u, low), high))  # faster than `clip`

    def _survived(self, x: Float[np.ndarray, "M n_x"]) -> tuple[int, bool]:
        """Return how many rows to keep, to the first unsafe or last finite, and if it failed."""
        finite = np.isfinite(x)
        whole = np.count_nonzero(finite) == finite.size  # faster than `all`
        if not whole:
            x = x[: np.argmin(finite.all(axis=1))]
        new = x[1:]  # the first row ended the period before
        unsafe = self.task.first_unsafe(new) if len(new) else None
        return (len(x), not whole) if unsafe is None else (unsafe + 2, True)

    def _info(self) -> dict[str, Any]:
        info: dict[str, Any] = {"t": self._t, "x": self._x.copy(), "u": self._u.copy()}
        return info if self._end is None else info | {"end": self._end.value}

    def _curves(self) -> list[DrawnCurve]:
        if self._episode is None:
            return []
        record, span = self.record(), (0.0, self.task.horizon)
        assert record.y is not None
        pairs = zip(self.channels.u, record.u.T, strict=True)
        return [
            *(DrawnCurve(self.channels.y[i], record.t, record.y[:, i], False, span) for i in self._tracked),
            *(DrawnCurve(channel, record.t, u, True, span) for channel, u in pairs),
        ]
