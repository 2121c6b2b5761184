"""The overtaking as a Gymnasium environment: one step is one sampling period."""

from typing import Any

import gymnasium as gym
import numpy as np
from jaxtyping import Float

from prefcal_env.control import Measurement
from prefcal_env.envs.checks import number, vector
from prefcal_env.envs.overtake.drive import ROAD_MARGIN, Mishap
from prefcal_env.envs.overtake.episode import Driven, Episode
from prefcal_env.envs.overtake.geometry import outside, overlap
from prefcal_env.envs.overtake.options import OvertakeOptions
from prefcal_env.envs.overtake.reward import MISHAP_COST, stage_cost
from prefcal_env.envs.trajectory import Record
from prefcal_env.errors import PlantError, ProtocolError, SettingsError
from prefcal_env.experiment import Channels, End
from prefcal_env.overtaking import HORIZON, START, T_S_RANGE, gap
from prefcal_env.plants.bicycle import KMH

Array = np.ndarray[Any, Any]
_DEFAULT_T_S = 0.1
_RESET_OPTIONS = ("T_s", "x0")
_OBSERVED = np.array([
    (40 * KMH, 70 * KMH), (-np.pi / 4, np.pi / 4),  # v and δ_s last
    (-3.0, 7.0), (-np.pi / 2, np.pi / 2),  # y_f, θ
    (-30.0, 30.0), (-7.0, 7.0), (0.0, 1.0),  # gap, lateral offset, phase
])  # fmt: skip


class OvertakeEnv(gym.Env[Array, Array]):
    """Keep the lane at 50 km/h, overtake at 60 km/h who drives slower. Section IV-B.

    The own vehicle starts at (0, 0), the paper's obstacle 30 m ahead at 40 km/h.

    - Action, float, shape (2,): v and δ_s, [-1, 1] from their low to their high limit
      (40 to 70 km/h, ±45°). Beyond the limits they saturate, as the actuators do.
    - Observation, float32, shape (7,): v and δ_s last, y_f, θ, gap and y_f - y_o to the nearest
      obstacle, phase; scaled to [-1, 1] and clipped. With noise, as measured.
    - Reward: minus `stage_cost` (speed, lane, steering) times the duration of the step; after
      a mishap also minus `MISHAP_COST` times the rest of the horizon.
    - terminated: collision, more than 1 m off the road, or a state that is not finite.
      truncated: the first sample at or after 15 s.
    - Info: `t` [s], `x` and `u` in the plant's units, `gap`, `lateral_offset` [m], `phase`;
      `end` at the end, and `mishap` where there was one.
    - Options of `reset`: `T_s` in [0.085, 0.5] s, any; `x0`, the pose (x_f, y_f, θ).

    Measured disturbances are (x_o, y_o, v_o) of every obstacle. The seed of `reset` decides the
    measurement noise, if there is any.

    Args:
        options: What differs from the paper; None: nothing.
        render_mode: None or "rgb_array": highway-env's picture of the scene.

    Raises:
        SettingsError: an unknown render mode, or options that are none.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 10}  # noqa: RUF012

    def __init__(
        self, options: OvertakeOptions | None = None, render_mode: str | None = None
    ) -> None:
        if not isinstance(options, OvertakeOptions | None):
            raise SettingsError(f"options must be OvertakeOptions, got {options!r}")
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise SettingsError(f"render_mode must be None or 'rgb_array', got {render_mode!r}")
        self.options, self.render_mode = options or OvertakeOptions(), render_mode
        self.plant = self.options.car.plant
        limits = np.array([(c.low, c.high) for c in self.plant.inputs])
        self._low, self._high = limits.T
        self.channels = Channels(self.plant.states, self.plant.inputs, self.plant.outputs)
        self.action_space = gym.spaces.Box(-1.0, 1.0, (2,), np.float32)
        self.observation_space = gym.spaces.Box(-1.0, 1.0, (len(_OBSERVED),), np.float32)
        self._episode: Episode | None = None
        self._scene: Any = None

    @property
    def T_s(self) -> float:
        """Sampling time of this episode [s]."""
        return self._begun().T_s

    @property
    def end(self) -> End | None:
        """Why the episode is over; None while it goes on, and before the first one."""
        return None if self._episode is None else self._episode.end

    @property
    def mishap(self) -> Mishap | None:
        """What ended the episode before its time, if anything did."""
        return None if self._episode is None else self._episode.mishap

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Start an episode; options `T_s` [s] and `x0`, the pose (x_f, y_f [m], θ [rad]).

        Raises:
            SettingsError: an unknown option, or a sampling time out of range.
            PlantError: a pose of the wrong shape, not finite, off the road or in a collision.
        """
        super().reset(seed=seed)
        options = options or {}
        unknown = sorted(set(options) - set(_RESET_OPTIONS))
        if unknown:
            raise SettingsError(f"reset options must be among {_RESET_OPTIONS}, got {unknown}")
        T_s = number(options.get("T_s", _DEFAULT_T_S), T_S_RANGE, "T_s")
        pose = vector(options.get("x0", START), 3, "initial pose x0")
        now = np.zeros(1)
        touching = any(overlap(pose[None], o.poses(now))[0] for o in self.options.obstacles)
        if touching or outside(pose[None])[0] > ROAD_MARGIN:
            raise PlantError(f"the initial pose x0 is in a collision or off the road: {pose}")
        self._episode = Episode(self.options, pose, T_s, self.np_random)
        return self.observe(), self._info()

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Apply `action`, shape (2,), v and δ_s scaled to [-1, 1], for one sampling period.

        Raises:
            PlantError: an action of the wrong shape or not finite.
            ProtocolError: no episode is under way.
        """
        driven = self.apply(self.inputs(action))
        duration = driven.t[-1] - driven.t[0]
        reward = -stage_cost(driven.t, driven.poses[:, 1], driven.u, driven.phase) * duration
        terminated, truncated = self.mishap is not None, self.end is End.TIME_UP
        if terminated:
            reward -= MISHAP_COST * max(HORIZON - driven.t[-1], 0.0)
        return self.observe(), float(reward), terminated, truncated, self._info()

    def inputs(self, action: Array) -> Float[np.ndarray, " 2"]:
        """v [m/s] and δ_s [rad] that `action` stands for, both shape (2,).

        Raises:
            PlantError: an action of the wrong shape or not finite.
        """
        a = vector(action, 2, "action")
        return np.asarray(self._low + (a + 1) / 2 * (self._high - self._low))

    def apply(self, u: Float[np.ndarray, " 2"]) -> Driven:
        """Hold v [m/s] and δ_s [rad], shape (2,), for one sampling period; they saturate.

        Raises:
            PlantError: inputs of the wrong shape or NaN.
            ProtocolError: no episode is under way.
        """
        episode = self._begun()
        if episode.end is not None:
            raise ProtocolError("the episode is over: call reset() first")
        u = vector(u, 2, "input u", finite=False)
        return episode.apply(np.minimum(np.maximum(u, self._low), self._high))

    def observe(self) -> Array:
        """The observation of now, as `reset` and `step` return it. ProtocolError before any."""
        episode = self._begun()
        _, y, yaw = episode.measured
        distance, offset = self._nearest(episode.measured)
        raw = np.array([*episode.u, y, yaw, distance, offset, episode.phase])
        low, high = _OBSERVED.T
        scaled: Array = np.clip(2 * (raw - low) / (high - low) - 1, -1, 1)
        return scaled.astype(np.float32)

    def measurement(self) -> Measurement:
        """What a controller knows now: x the measured pose, d (x_o, y_o, v_o) of each obstacle.

        `y_ref` is (x_f, 0, 0), that of lane keeping; references that follow from the phase are
        the controller's own. Raises ProtocolError before the first episode.
        """
        return self._begun().measurement()

    def record(self) -> Record:
        """The episode so far, or the last one once it has ended. Raises ProtocolError if none.

        Recorded are n sub-steps of T_s/n a period, of 0.02 s at most, and the end; a collision at
        its very time. Its signals are those of `signals_of`.
        """
        return self._begun().record(self.channels)

    def render(self) -> Array | None:
        """The scene as it is now, (height, width, 3) uint8; None without render mode."""
        if self.render_mode is None:
            return None
        if self._scene is None:
            # Here, not above: whoever does not render must not load highway-env and pygame.
            from prefcal_env.envs.overtake.scene import Scene

            self._scene = Scene(len(self.options.obstacles))
        episode = self._begun()
        self._scene.show(
            episode.x[:3], episode.obstacles, episode.u, collided=self.mishap is Mishap.COLLISION
        )
        return np.asarray(self._scene.render())

    def close(self) -> None:
        """Let go of the scene."""
        if self._scene is not None:
            self._scene.close()
        self._scene = None

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_scene": None}  # pictures cannot be pickled, and are made anew

    def _begun(self) -> Episode:
        if self._episode is None:
            raise ProtocolError("no episode yet: call reset() first")
        return self._episode

    def _info(self) -> dict[str, Any]:
        episode = self._begun()
        distance, offset = self._nearest(episode.x)
        info: dict[str, Any] = {
            "t": episode.t, "x": episode.x.copy(), "u": episode.u.copy(),
            "gap": distance, "lateral_offset": offset, "phase": int(episode.phase),
        }  # fmt: skip
        if episode.end is not None:
            info["end"] = episode.end.value
        if episode.mishap is not None:
            info["mishap"] = episode.mishap.value
        return info

    def _nearest(self, pose: Array) -> tuple[float, float]:
        """Gap and y_f - y_o to the obstacle that is nearest along the road [m]."""
        x, y = float(pose[0]), float(pose[1])
        rows = self._begun().obstacles.tolist()
        x_o, y_o, _ = min(rows, key=lambda row: abs(row[0] - x))
        return gap(x, x_o), y - y_o
