"""The default observation and action of the overtaking, as types of highway-env. Loads it."""

from typing import Any

import gymnasium as gym
import numpy as np
from highway_env.envs.common.action import ActionType, action_factory
from highway_env.envs.common.observation import ObservationType, observation_factory
from jaxtyping import Float

from prefcal_env.envs.checks import vector
from prefcal_env.envs.overtake.road.vehicles import OwnVehicle
from prefcal_env.errors import SettingsError
from prefcal_env.plants.bicycle import KMH

Array = np.ndarray[Any, Any]
OBSERVATION, ACTION = "OvertakeObservation", "SpeedSteeringAction"
OBSERVATIONS = (OBSERVATION, "Kinematics", "OccupancyGrid", "LidarObservation", "TupleObservation")
ACTIONS = (ACTION, "ContinuousAction", "DiscreteAction")
"""Action types that a configuration can name; all but `ACTION` are highway-env's."""
_OBSERVED = np.array([
    (40 * KMH, 70 * KMH), (-np.pi / 4, np.pi / 4),  # v and δ_s last
    (-3.0, 7.0), (-np.pi / 2, np.pi / 2),  # y_f, θ
    (-30.0, 30.0), (-7.0, 7.0), (0.0, 1.0),  # gap, lateral offset, phase
])  # fmt: skip


class OvertakeObservation(ObservationType):  # type: ignore[misc]
    """The measured last v and δ_s, y_f, θ, gap and y_f - y_o to the nearest vehicle, and phase.

    float32, shape (7,): each value is scaled to [-1, 1] and clipped.
    """

    def space(self) -> gym.spaces.Box:
        """Return the box [-1, 1], shape (7,)."""
        return gym.spaces.Box(-1.0, 1.0, (len(_OBSERVED),), np.float32)

    def observe(self) -> Float[np.ndarray, " 7"]:
        """Return the current observation."""
        episode = self.env.episode
        _, y, yaw = episode.measured
        distance, offset = episode.nearest(episode.measured)
        raw = np.array([*episode.u, y, yaw, distance, offset, episode.phase])
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
        low, high = self.env.course.low, self.env.course.high
        v, steering = (low + (vector(action, 2, "action") + 1) / 2 * (high - low)).tolist()
        self.controlled_vehicle.act({"speed": v, "steering": -steering, "acceleration": 0.0})


def observation_of(env: Any, config: Any) -> ObservationType:
    """Return the observation type of a configuration. Raises SettingsError if it is unknown."""
    _check(config, OBSERVATIONS, "observation")
    return (
        OvertakeObservation(env)
        if config["type"] == OBSERVATION
        else observation_factory(env, config)
    )


def action_of(env: Any, config: Any) -> ActionType:
    """Return the action type of a configuration. Raises SettingsError if it is unknown."""
    _check(config, ACTIONS, "action")
    return SpeedSteeringAction(env) if config["type"] == ACTION else action_factory(env, config)


def _check(config: Any, known: tuple[str, ...], what: str) -> None:
    if not isinstance(config, dict) or config.get("type") not in known:
        raise SettingsError(f'{what} must be like {{"type": ...}}, one of {known}, got {config!r}')
