"""What may differ from the paper's overtaking; by default nothing does."""

from dataclasses import dataclass, field

import numpy as np

from prefcal_env.envs.overtake.traffic import Obstacle
from prefcal_env.errors import SettingsError
from prefcal_env.overtaking import KEEPING_SPEED
from prefcal_env.plants.bicycle import Bicycle
from prefcal_env.plants.cars import dynamic_bicycle, slip_bicycle
from prefcal_env.plants.plant import Plant


@dataclass(frozen=True, slots=True)
class Car:
    """The own vehicle: what moves it, and what its states are at the start.

    Args:
        plant: Inputs (v [m/s], δ_s [rad]); the first three states are (x_f, y_f [m], θ [rad]).
        others: The states after these at the start, shape (n_x - 3,).

    Raises:
        SettingsError: not two inputs with finite limits, or not three states and `others`;
            measured disturbances (nothing would measure them).
    """

    plant: Plant = field(default_factory=Bicycle)
    others: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        plant, n_x = self.plant, 3 + len(self.others)
        limits = [limit for c in plant.inputs for limit in (c.low, c.high)]
        if len(plant.inputs) != 2 or not np.isfinite(limits).all():
            raise SettingsError(f"car: plant {plant.name!r} needs two inputs with finite limits")
        if len(plant.states) != n_x or plant.disturbances:
            raise SettingsError(
                f"car: plant {plant.name!r} must have {n_x} states, a pose and {self.others}, "
                f"and no disturbance; got {len(plant.states)} and {len(plant.disturbances)}"
            )


def slipping_car() -> Car:
    """The bicycle of highway-env, whose speed needs time; see `slip_bicycle`."""
    return Car(slip_bicycle(), (KEEPING_SPEED,))


def dynamic_car() -> Car:
    """A car with mass and tyres; see `dynamic_bicycle`."""
    return Car(dynamic_bicycle(), (KEEPING_SPEED, 0.0, 0.0))


@dataclass(frozen=True, slots=True)
class OvertakeOptions:
    """The scene of `OvertakeEnv`; by default the paper's.

    Args:
        car: The own vehicle; by default the kinematic bicycle that the MPC knows.
        obstacles: The other vehicles, at least one. They do not see each other.
        noise: Standard deviations of the measured x_f, y_f [m] and θ [rad]; normal, without
            memory, and drawn from the seed of `reset`.

    Raises:
        SettingsError: no obstacle, or a noise that is negative or not finite.
    """

    car: Car = field(default_factory=Car)
    obstacles: tuple[Obstacle, ...] = (Obstacle(),)
    noise: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        if not self.obstacles or not all(isinstance(o, Obstacle) for o in self.obstacles):
            raise SettingsError(f"obstacles must be a tuple of Obstacle, got {self.obstacles!r}")
        if len(self.noise) != 3 or not all(0 <= s < np.inf for s in self.noise):
            raise SettingsError(
                f"noise must be 3 standard deviations, finite and at least 0, got {self.noise}"
            )
