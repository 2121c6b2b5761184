"""The overtaking as an environment of highway-env: one step is one sampling period."""

from typing import Any

import gymnasium as gym
import numpy as np
from highway_env.envs.common.abstract import AbstractEnv
from highway_env.envs.common.action import ActionType, action_factory
from highway_env.envs.common.graphics import EnvViewer
from highway_env.envs.common.observation import ObservationType, observation_factory
from jaxtyping import Float

from prefcal_env.arrays import known_options, number_in, plant_vector
from prefcal_env.envs.canvas import check_render_mode
from prefcal_env.envs.task import Period
from prefcal_env.errors import PlantError, SettingsError
from prefcal_env.experiments.experiment import End, Measurement, Record
from prefcal_env.plants.bicycle import KMH

from .course import Course, Mishap
from .scene import HIGH, LOW, MISHAP_COST, T_S_RANGE, OvertakeOptions, paper_scene, stage_cost
from .vehicles import CRASHED, OWN, OwnVehicle, place, road_of

Array = np.ndarray[Any, Any]
KINDS = {
    "observation": (
        "OvertakeObservation",
        "Kinematics",
        "OccupancyGrid",
        "LidarObservation",
        "TupleObservation",
    ),
    "action": ("SpeedSteeringAction", "ContinuousAction", "DiscreteAction"),
}
"""Types that a configuration can name; the first one is ours, the others are highway-env's."""
_OBSERVED = np.array(
    [
        (40 * KMH, 70 * KMH),
        (-np.pi / 4, np.pi / 4),  # v and δ_s last
        (-3.0, 7.0),
        (-np.pi / 2, np.pi / 2),  # y_f, θ
        (-30.0, 30.0),
        (-7.0, 7.0),
        (0.0, 1.0),  # gap, lateral offset, phase
    ]
)


class OvertakeObservation(ObservationType):  # type: ignore[misc]
    """The last v and δ_s, y_f, θ, gap and y_f - y_o to the nearest vehicle, and phase.

    float32, shape (7,): each value is scaled to [-1, 1] and clipped.
    """

    def space(self) -> gym.spaces.Box:
        """Return the box [-1, 1], shape (7,)."""
        return gym.spaces.Box(-1.0, 1.0, (len(_OBSERVED),), np.float32)

    def observe(self) -> Float[np.ndarray, " 7"]:
        """Return the current observation."""
        course = self.env.course
        raw = np.array([*course.u, *course.x[1:], *course.nearest(), course.phase])
        low, high = _OBSERVED.T
        scaled: Array = np.clip(2 * (raw - low) / (high - low) - 1, -1, 1)
        return scaled.astype(np.float32)


class SpeedSteeringAction(ActionType):  # type: ignore[misc]
    """v and δ_s, float, shape (2,): [-1, 1] from their low to their high limit, δ_s to the left."""

    vehicle_class = OwnVehicle

    def space(self) -> gym.spaces.Box:
        """Return the box [-1, 1], shape (2,)."""
        return gym.spaces.Box(-1.0, 1.0, (2,), np.float32)

    def act(self, action: Any) -> None:
        """Pass `action` to the ego vehicle. Raises PlantError if it is not 2 finite numbers."""
        v, steering = (LOW + (plant_vector(action, 2, "action") + 1) / 2 * (HIGH - LOW)).tolist()
        self.controlled_vehicle.act({"speed": v, "steering": -steering, "acceleration": 0.0})


class RoadViewer(EnvViewer):  # type: ignore[misc]
    """highway-env's viewer, with the whole road in the picture."""

    def __init__(self, env: Any) -> None:
        right, left = env.options.road
        height = env.config["screen_height"]
        height = height or round(env.config["scaling"] * (left - right + 6.6667))  # m beside the road
        super().__init__(env, env.config | {"screen_height": height})
        self.enabled = True  # it draws on a surface, which no video driver concerns

    def window_position(self) -> Float[np.ndarray, " 2"]:
        """Return the view position: beside the ego vehicle, on the middle of the road."""
        return np.array([self.env.vehicle.position[0], -sum(self.env.options.road) / 2])


class OvertakeEnv(AbstractEnv):  # type: ignore[misc]
    """The overtaking of section IV-B: keep the lane at 50 km/h, overtake slower traffic at 60 km/h.

    The ego vehicle starts at (0, 0), the paper's obstacle 30 m ahead at 40 km/h. `config` changes
    the scene, the observation and the action; see `default_config`.

    - Action, by default float, shape (2,): v and δ_s, [-1, 1] from their low to their high limit
      (40 to 70 km/h, ±45°). Beyond the limits they saturate, as actuators do.
    - Observation, by default float32, shape (7,): see `OvertakeObservation`.
    - Reward: minus `stage_cost` (speed, lane, steering) times the duration of the step; after
      a mishap also minus `MISHAP_COST` times the rest of the horizon.
    - terminated: collision, or more than 1 m off the road. truncated: the first sample at or after
      15 s. A state is always finite: the inputs saturate.
    - Info: `t` [s], `x` and `u` in the plant's units, `speed` [m/s], `crashed`, `gap`,
      `lateral_offset` [m], `phase`; `end` at the end, and `mishap` if there was one.
    - Options of `reset`: any `T_s` in [0.085, 0.5] s; `x0`, the pose (x_f, y_f, θ); `config`.

    Measured disturbances are (x_o, y_o, v_o) of every other vehicle. The seed of `reset`
    determines highway-env's drivers, if the configuration asks for any.

    Deviation from highway-env: its step counts frames by a rounded ratio, which loses some frames
    if T_s is odd, and its frames cost more than a whole experiment may. So we simulate a step
    ourselves (`Course`): exact at any instant, and drivers decide n times T_s/n in a period.

    Args:
        config: Differences from `default_config`.
        T_s: Sampling time [s]; None uses that of the configuration.
        x0: Initial pose (x_f, y_f [m], θ [rad]); None uses that of the configuration.
        render_mode: None, or "rgb_array" for highway-env's picture of the scene.

    Raises:
        SettingsError: If the render mode is unknown or the configuration is not valid.
    """

    plant, channels = Course.plant, Course.channels
    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 10}  # noqa: RUF012

    def __init__(
        self,
        config: dict[str, Any] | None = None,
        *,
        T_s: float | None = None,
        x0: Any = None,
        render_mode: str | None = None,
    ) -> None:
        check_render_mode(render_mode, self.metadata)
        self.metadata = dict(self.metadata)  # a copy, because highway-env writes into it
        self.action_space: Any = None
        self.observation_space: Any = None
        self.viewer: Any = None
        self._once: dict[str, Any] = {}
        self._reward_of_step = 0.0
        given = {name: value for name, value in (("T_s", T_s), ("x0", x0)) if value is not None}
        super().__init__({**(config or {}), **given} if given else config, render_mode)

    @classmethod
    def default_config(cls) -> dict[str, Any]:
        """Return highway-env's configuration with our scene, observation and action.

        The scene is that of `OvertakeOptions`. A `T_s` of None means 1/`policy_frequency`; with a
        `screen_height` of None the height follows from the lanes.
        """
        ours = {what: {"type": kinds[0]} for what, kinds in KINDS.items()} | {
            "policy_frequency": 10,
            "T_s": None,
            "screen_width": 960,
            "screen_height": None,
            "scaling": 12.0,
        }
        config: dict[str, Any] = super().default_config()
        return config | ours | paper_scene()

    def configure(self, config: dict[str, Any] | None) -> None:
        """Change the configuration. Raises SettingsError if it is not valid."""
        if not isinstance(config, dict | None):
            raise SettingsError(f"config must be a dict, got {config!r}")
        known = self.default_config()
        unknown = sorted({*self.config, *(config or {})} - set(known))
        if unknown:
            raise SettingsError(f"config has unknown keys {unknown}, expected some of {sorted(known)}")
        wanted = self.config | (config or {})
        options = OvertakeOptions.of({name: wanted[name] for name in paper_scene()})
        for what, kinds in KINDS.items():
            kind = wanted[what]
            if not isinstance(kind, dict) or kind.get("type") not in kinds:
                raise SettingsError(f'{what} must be like {{"type": ...}}, one of {kinds}, got {kind!r}')
        if wanted["T_s"] is None:
            frequencies = (1 / T_S_RANGE[1], 1 / T_S_RANGE[0])
            T_s = 1 / number_in(wanted["policy_frequency"], frequencies, "policy_frequency")
        else:
            T_s = number_in(wanted["T_s"], T_S_RANGE, "T_s")
        super().configure(config)  # called last, so that a refused configuration changes nothing
        self.options, self.course, self._usual_T_s = options, Course(options), T_s

    def define_spaces(self) -> None:
        """Set types and spaces of observation and action; equal spaces keep their identity."""
        seen, done = self.config["observation"], self.config["action"]
        ours = seen["type"] == KINDS["observation"][0]
        self.observation_type = OvertakeObservation(self) if ours else observation_factory(self, seen)
        ours = done["type"] == KINDS["action"][0]
        self.action_type = SpeedSteeringAction(self) if ours else action_factory(self, done)
        if self.observation_space != self.observation_type.space():
            self.observation_space = self.observation_type.space()
        if self.action_space != self.action_type.space():
            self.action_space = self.action_type.space()

    def update_metadata(self, video_real_time_ratio: float = 1.0) -> None:
        """Set the frame rate of videos to real time: one picture for each step."""
        self.metadata["render_fps"] = video_real_time_ratio / self.T_s

    @property
    def T_s(self) -> float:
        """Sampling time of this episode [s]."""
        return float(self._once.get("T_s") or self._usual_T_s)

    @property
    def end(self) -> End | None:
        """Why the episode ended; None while it goes on."""
        return self.course.end

    @property
    def mishap(self) -> Mishap | None:
        """Reason why the episode ended early; None if it did not."""
        return self.course.mishap

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Start an episode; `T_s` [s] and `x0` apply to this one, `config` from now on.

        What was written into `env.unwrapped.config` since counts from now on, too. Raises as
        `Course.reset` does, and SettingsError if the configuration is not valid.
        """
        given = known_options(options, ("T_s", "x0", "config"))
        config = given.pop("config", None)
        if given.get("T_s") is not None:
            number_in(given["T_s"], T_S_RANGE, "T_s")
        self.configure(config)  # also for what was written into `config`, highway-env's idiom
        self._once = given
        return super().reset(seed=seed)  # type: ignore[no-any-return]

    def inputs(self, action: Any) -> Float[np.ndarray, " 2"]:
        """Return v [m/s] and δ_s [rad] that `action` stands for, shape (2,).

        Raises:
            PlantError: If the action has the wrong shape, is not finite, or is not in a discrete
                space.
        """
        if isinstance(self.action_space, gym.spaces.Box):
            action = plant_vector(action, self.action_space.shape[0], "action")
        elif not self.action_space.contains(action):
            raise PlantError(f"action must be in {self.action_space}, got {action!r}")
        self.action_type.act(action)
        return self.vehicle.inputs(self.T_s)  # type: ignore[no-any-return]

    def apply(self, u: Float[np.ndarray, " 2"]) -> Period:
        """Hold v [m/s] and δ_s [rad], shape (2,), for one sampling period; see `Course.apply`."""
        phase = self.course.phase
        step = self.course.apply(u)
        self._reward_of_step = -stage_cost(step.t, step.x[:, 1], step.u, phase) * step.duration
        self.steps += 1
        self._place()
        return step

    def observe(self) -> Any:
        """Return the current observation, as `reset` and `step` do."""
        return self.observation_type.observe()

    def measurement(self) -> Measurement:
        """Return what a controller knows; see `Course.measurement`."""
        return self.course.measurement()

    def record(self) -> Record:
        """Return the current or last episode; see `Course.record`."""
        return self.course.record()

    def render(self) -> Array | None:
        """Return a picture of the scene, (height, width, 3) uint8; None without render mode."""
        if self.render_mode is None:
            return None
        if self.viewer is None:
            self.viewer = RoadViewer(self)
        return np.asarray(super().render())

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"viewer": None}  # pictures cannot be pickled; they are redrawn

    def _reset(self) -> None:
        course, options = self.course, {"T_s": self.T_s, "x0": self._once.get("x0")}
        course.reset(options=options, rng=self.np_random)
        if course.simulation is None:
            self.road = road_of(self.options, course.x, self.np_random)
        else:
            self.road = course.simulation.road
        self.road.record_history = self.config["show_trajectories"]
        self.vehicle = self.road.vehicles[0]
        self.viewer = None  # its size may have changed

    def _simulate(self, action: Any = None) -> None:
        self.apply(self.inputs(action))
        self.time = self.course.t

    def _place(self) -> None:
        """Put the ego vehicle and the obstacle where they are; drivers are there already.

        But if a mishap ended the period early, drivers have driven on to its end.
        """
        course, (own, obstacle, *drivers) = self.course, self.road.vehicles
        own.put(course.x, course.u)
        own.crashed = course.mishap is Mishap.COLLISION
        own.color = CRASHED if own.crashed else OWN
        obstacle.put(course.t)
        if course.mishap is not None:
            for driver, mover in zip(drivers, course.movers[1:], strict=True):
                place(driver, *mover.at(np.array([course.t]))[0, :3].tolist())

    def _reward(self, action: Any) -> float:
        rest = max(self.options.duration - self.course.t, 0.0) if self._is_terminated() else 0.0
        return float(self._reward_of_step - MISHAP_COST * rest)

    def _is_terminated(self) -> bool:
        return self.mishap is not None

    def _is_truncated(self) -> bool:
        return self.end is End.TIME_UP

    def _info(self, obs: Any, action: Any = None) -> dict[str, Any]:
        course = self.course
        distance, offset = course.nearest()
        info: dict[str, Any] = {
            "t": course.t,
            "x": course.x.copy(),
            "u": course.u.copy(),
            "speed": float(self.vehicle.speed),
            "crashed": bool(self.vehicle.crashed),
            "gap": distance,
            "lateral_offset": offset,
            "phase": int(course.phase),
        }
        if course.end is not None:
            info["end"] = course.end.value
        if course.mishap is not None:
            info["mishap"] = course.mishap.value
        return info
