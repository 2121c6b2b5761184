"""The default observation and action of the overtaking, as types of highway-env. Loads it."""

from collections.abc import Mapping
from typing import Any

import gymnasium as gym
import numpy as np
from highway_env.envs.common.action import ActionType, action_factory
from highway_env.envs.common.observation import ObservationType, observation_factory
from jaxtyping import Float

from prefcal_env.envs.checks import number, numbers, vector
from prefcal_env.envs.overtake.road.vehicles import OwnVehicle
from prefcal_env.errors import SettingsError
from prefcal_env.plants.bicycle import KMH

from .course import HIGH, LOW

Array = np.ndarray[Any, Any]
OBSERVATION, ACTION = "OvertakeObservation", "SpeedSteeringAction"
OBSERVATIONS = (OBSERVATION, "Kinematics", "OccupancyGrid", "LidarObservation", "TupleObservation")
ACTIONS = (ACTION, "ContinuousAction", "DiscreteAction")
"""Action types that a configuration can name; all but `ACTION` are highway-env's."""
_SWITCHES = ("manual_control", "show_trajectories", "render_agent", "real_time_rendering")
_OBSERVED = np.array([
    (40 * KMH, 70 * KMH), (-np.pi / 4, np.pi / 4),  # v and δ_s last
    (-3.0, 7.0), (-np.pi / 2, np.pi / 2),  # y_f, θ
    (-30.0, 30.0), (-7.0, 7.0), (0.0, 1.0),  # gap, lateral offset, phase
])  # fmt: skip


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
        v, steering = (LOW + (vector(action, 2, "action") + 1) / 2 * (HIGH - LOW)).tolist()
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


def check_pictures(config: Mapping[str, Any]) -> None:
    """Check the entries of a configuration that change only what its pictures show.

    Raises:
        SettingsError: If one is not valid, or highway-env's window is asked for.
    """
    if config["manual_control"]:
        raise SettingsError(
            "manual_control must be False: prefcal draws without a window, so no key reaches the "
            f"car; got {config['manual_control']!r}"
        )
    for name in _SWITCHES:
        if not isinstance(config[name], bool):
            raise SettingsError(f"{name} must be True or False, got {config[name]!r}")
    for name in ("screen_width", "screen_height"):
        pixels = config[name]
        if pixels is not None or name == "screen_width":
            pixels = number(pixels, (16, 8192), f"{name} in pixels")
            if pixels != int(pixels):
                raise SettingsError(f"{name} must be whole pixels, got {pixels}")
    number(config["scaling"], (0.1, 1000.0), "scaling in pixels per m")
    center = numbers(config["centering_position"], "centering_position", SettingsError)
    if center.shape != (2,) or np.any((center < 0) | (center > 1)):
        raise SettingsError(
            f"centering_position must be 2 shares of the picture in [0, 1], got {center.tolist()}"
        )
