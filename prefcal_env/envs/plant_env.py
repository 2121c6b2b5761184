"""A plant and a task as a Gymnasium environment: one step is one sampling period."""

from dataclasses import replace
from functools import cached_property
from typing import Any

import gymnasium as gym
import numpy as np
from jaxtyping import Float

from prefcal_env.errors import PlantError, ProtocolError, SettingsError
from prefcal_env.experiments.control import Measurement
from prefcal_env.experiments.experiment import End
from prefcal_env.experiments.trajectory import Record, Trajectory, instants
from prefcal_env.plants.plant import Plant

from .canvas import Canvas, DrawnCurve, check_render_mode
from .checks import known_options, vector
from .dead_time import DeadTime, dead_times, delays_of
from .fit import channels_of, check_fit, check_limits, check_rate, observed_of, tracked_of
from .task import Period, Task

Array = np.ndarray[Any, Any]
_RESET_OPTIONS = ("T_s", "x0")


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
        self._outputs_are_states = outputs_are_states
        self._tracked, self._observed = tracked_of(task), observed_of(plant, task)
        panels = len(self._tracked) + len(plant.inputs)
        self._canvas = Canvas(plant.name, f"time [{plant.time_unit}]", panels)
        self._episode: Trajectory | None = None
        self._end: End | None = None
        self._T_s, self._steps = task.T_s, 0
        self._t, self._x, self._u = 0.0, task.x0, task.u0
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
        options = known_options(options, _RESET_OPTIONS)
        T_s = self._sampling_time(options.get("T_s", self.task.T_s))
        x0 = vector(options.get("x0", self.task.x0), len(self.plant.states), "initial state x0")
        if self.task.unsafe(x0):
            raise PlantError(f"the initial state x0 is unsafe: {x0}")
        self._T_s, self._steps, self._end = T_s, 0, None
        self._t, self._x, self._u = 0.0, x0, self.task.u0
        self._episode = Trajectory(x0, self.task.u0)
        if self._delayed:
            start = x0, self.task.u0, self.task.disturbance(0.0)
            self._dead_time = DeadTime(self.plant, *start)
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
        a = vector(action, len(self._low), "action")
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
        u = self._saturated(vector(u, len(self._low), "input u", finite=False))
        y_ref, d = self.task.reference(self._t), self.task.disturbance(self._t)
        self._steps += 1
        late = self.task.jitter * int(self.np_random.integers(-1, 2)) if self.task.jitter else 0.0
        t = instants(self._t, (self._steps + late) * self._T_s, self.task.dense_step)
        if self._dead_time is None:
            later = self.plant.hold(self._x, u, d, t[1:] - self._t)
        else:
            later = self._dead_time.hold(self._x, u, d, t)
        x = np.concatenate([self._x[None], later])
        kept, stopped = self._survived(x)
        if stopped:
            if kept == self._steps == 1:
                check_rate(self.plant, self._x, u, d)
            t, x = t[:kept], x[:kept]
        self._episode.add(t[1:], x[1:], u, y_ref)
        step = Period(t, x, u_before=self._u, u=u, y_ref=y_ref, T_s=self._T_s)
        self._t, self._x, self._u = float(t[-1]), x[-1], u
        self._draw_noise()
        if stopped:
            self._end = End.UNSAFE
        elif self.task.settled(step):
            self._end = End.SETTLED
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
        return Measurement(self._t, self._x, self._u, d, y_ref, self._measured(d) + self._noise)

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
        if self._outputs_are_states:
            return record.x.copy()
        held = np.searchsorted(record.t_control, record.t, side="right") - 1
        sampled = record.t_control if len(record.t_control) else record.t
        d = [self.task.disturbance(t) for t in sampled.tolist()]
        rows = zip(record.x, record.u, np.maximum(held, 0).tolist(), strict=True)
        y = [self.plant.g(x, u, d[k]) for x, u, k in rows]
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
        if self._outputs_are_states:
            return self._x
        now = d if d.ndim == 1 else d[0]
        return np.asarray(self.plant.g(self._x, self._u, now), dtype=float)

    def _draw_noise(self) -> None:
        """Draw the noise of the next measurement: once a step, however often it is read."""
        if self.task.noise is not None:
            self._noise = self.task.noise * self.np_random.standard_normal(len(self._noise))

    def _sampling_time(self, T_s: Any) -> float:
        found, dt = self.task.sampling_time(T_s), getattr(self.plant, "sample_time", 0.0)
        steps = found / dt if dt else 1.0
        if abs(steps - round(steps)) > 1e-6 or round(steps) < 1:
            raise SettingsError(
                f"the controller's T_s must be a multiple of the sample time {dt:g} "
                f"{self.plant.time_unit} of plant {self.plant.name!r}, got {found:g}"
            )
        return found

    def _saturated(self, u: Array) -> Array:
        low, high, move = self._low, self._high, self.task.max_move
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
        shown = [(self.channels.y[i], record.y[:, i], False) for i in self._tracked]
        shown += [(channel, u, True) for channel, u in zip(self.channels.u, record.u.T, strict=True)]
        return [DrawnCurve(channel, record.t, values, held, span) for channel, values, held in shown]
