"""Options of the overtaking scene; the defaults are the paper's."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any

from prefcal_env.envs.checks import number, vector
from prefcal_env.errors import SettingsError
from prefcal_env.plants.bicycle import Bicycle

from .rules import HORIZON, LANE_WIDTH, START

DRIVERS = tuple(
    f"highway_env.vehicle.behavior.{name}"
    for name in ("IDMVehicle", "LinearVehicle", "AggressiveVehicle", "DefensiveVehicle")
)
"""Types of drivers in highway-env."""


@dataclass(frozen=True, slots=True)
class OvertakeOptions:
    """The scene of the overtaking; the defaults are the paper's.

    The traffic besides the paper's obstacle is highway-env's own: `vehicles_count` drivers, placed
    and made random by highway-env from the seed of `reset`, one ahead of the other.

    Args:
        x0: Initial pose of the ego vehicle: x_f, y_f [m] and θ [rad].
        duration: Duration: an episode lasts until the first sample at or after it [s].
        lanes_count: Number of lanes, 4 m wide; ours is the rightmost, at y = 0.
        vehicles_count: Number of drivers ahead of the obstacle.
        vehicles_density: Density of these drivers, as in highway-env.
        other_vehicles_type: Type of these drivers, one of `DRIVERS`.
        simulation_frequency: Frequency of their decisions [Hz]; at least one per period.
        wheelbase: Distance of the axles of the car [m]; a controller need not know it.

    Raises:
        SettingsError: If a number is out of range or the type is unknown.
    """

    x0: tuple[float, float, float] = START
    duration: float = HORIZON
    lanes_count: int = 2
    vehicles_count: int = 0
    vehicles_density: float = 1.0
    other_vehicles_type: str = DRIVERS[0]
    simulation_frequency: float = 15.0
    wheelbase: float = Bicycle().length

    def __post_init__(self) -> None:
        object.__setattr__(self, "x0", tuple(vector(self.x0, 3, "initial pose x0").tolist()))
        number(self.duration, (0.5, 3600.0), "duration [s]")
        number(self.vehicles_density, (0.01, 100.0), "vehicles_density")
        number(self.wheelbase, (0.5, 50.0), "wheelbase [m]")
        number(self.simulation_frequency, (1.0, 1000.0), "simulation_frequency [Hz]")
        for name, low, high in (("lanes_count", 1, 10), ("vehicles_count", 0, 1000)):
            count = getattr(self, name)
            if not isinstance(count, int) or isinstance(count, bool) or not low <= count <= high:
                raise SettingsError(f"{name} must be a whole number in [{low}, {high}], got {count!r}")
        if self.other_vehicles_type not in DRIVERS:
            raise SettingsError(
                f"other_vehicles_type must be one of {DRIVERS}, got {self.other_vehicles_type!r}"
            )

    @property
    def road(self) -> tuple[float, float]:
        """Right and left edge of the road, y [m]."""
        return -LANE_WIDTH / 2, (self.lanes_count - 0.5) * LANE_WIDTH

    @classmethod
    def of(cls, config: Mapping[str, Any]) -> "OvertakeOptions":
        """Return the scene of a configuration, plain data; missing keys are as in the paper.

        Raises:
            SettingsError: If a key is unknown or a value has the wrong type.
        """
        known = {f.name for f in fields(cls)}
        unknown = sorted(set(config) - known)
        if unknown:
            raise SettingsError(f"a scene has unknown keys {unknown}, expected some of {sorted(known)}")
        return cls(**config)


def paper_scene() -> dict[str, Any]:
    """Return the configuration of the paper's scene, with all keys."""
    return asdict(OvertakeOptions()) | {"x0": list(START)}
