"""Options of the overtaking scene; the defaults are the paper's."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from functools import partial
from typing import Any, TypeVar

import numpy as np

from prefcal_env.envs.checks import vector
from prefcal_env.errors import SettingsError
from prefcal_env.plants.bicycle import Bicycle
from prefcal_env.plants.cars import dynamic_bicycle, slip_bicycle
from prefcal_env.plants.plant import Plant

from .random_traffic import KINDS, RandomTraffic
from .rules import HORIZON, KEEPING_SPEED, LANE_WIDTH, START
from .traffic import Driver, Obstacle


@dataclass(frozen=True, slots=True)
class Car:
    """The ego vehicle: the plant that moves it, and the initial values of its states.

    Args:
        plant: Plant with inputs (v [m/s], δ_s [rad]) and first states (x_f, y_f [m], θ [rad]).
        others: Initial values of the remaining states, shape (n_x - 3,).

    Raises:
        SettingsError: If the plant does not have two inputs with finite limits, or three states
            and `others`; or if it has measured disturbances (nothing would measure them).
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
    """Return the bicycle of highway-env, whose speed has a lag; see `slip_bicycle`."""
    return Car(slip_bicycle(), (KEEPING_SPEED,))


def dynamic_car() -> Car:
    """Return a car with mass and tires; see `dynamic_bicycle`."""
    return Car(dynamic_bicycle(), (KEEPING_SPEED, 0.0, 0.0))


CARS: Mapping[str, Callable[[], Car]] = {
    "kinematic": Car,
    "slipping": slipping_car,
    "dynamic": dynamic_car,
}
"""Maps names in a configuration to ego vehicles."""
DRIVERS = ("IDMVehicle", "LinearVehicle", "AggressiveVehicle", "DefensiveVehicle")
"""Types of drivers in highway-env's `highway_env.vehicle.behavior`."""
Made = TypeVar("Made")
_BEHAVIOR = "highway_env.vehicle.behavior."


@dataclass(frozen=True, slots=True)
class OvertakeOptions:
    """The scene of the overtaking; the defaults are the paper's.

    Args:
        car: Ego vehicle; by default the kinematic bicycle that the MPC uses as its model.
        traffic: Other vehicles; together with `random_traffic` at least one.
        random_traffic: Additional vehicles, drawn anew for each episode; None for none.
        noise: Standard deviations of the measured x_f, y_f [m] and θ [rad]. The noise is normal
            and white, and is drawn from the seed of `reset`.
        x0: Initial pose of the ego vehicle: x_f, y_f [m] and θ [rad].
        duration: Duration: an episode lasts until the first sample at or after it [s].
        lanes_count: Number of lanes in our direction, 4 m wide; ours is the rightmost, at y = 0.
        oncoming_lanes_count: Number of lanes in the other direction, to the left of ours.
        simulation_frequency: Frequency of the drivers' decisions [Hz]; at least one per period.
        other_vehicles_type: Type of the drivers, one of `DRIVERS` with or without its module.

    Raises:
        SettingsError: If there is no other vehicle, a vehicle is on a missing lane, or a number is
            out of range.
    """

    car: Car = field(default_factory=Car)
    traffic: tuple[Obstacle | Driver, ...] = (Obstacle(),)
    random_traffic: RandomTraffic | None = None
    noise: tuple[float, float, float] = (0.0, 0.0, 0.0)
    x0: tuple[float, float, float] = START
    duration: float = HORIZON
    lanes_count: int = 2
    oncoming_lanes_count: int = 0
    simulation_frequency: float = 15.0
    other_vehicles_type: str = _BEHAVIOR + DRIVERS[0]

    def __post_init__(self) -> None:
        drawn = 0 if self.random_traffic is None else self.random_traffic.count
        if not (self.traffic or drawn) or not all(
            isinstance(o, Obstacle | Driver) for o in self.traffic
        ):
            raise SettingsError(
                "traffic must hold one or more vehicles, Obstacle or Driver (or random_traffic "
                f"must), got {self.traffic!r}"
            )
        object.__setattr__(self, "x0", tuple(vector(self.x0, 3, "initial pose x0").tolist()))
        if vector(self.noise, 3, "noise").min() < 0:
            raise SettingsError(
                f"noise must be 3 standard deviations of at least 0, got {self.noise}"
            )
        _check_number("duration", self.duration, 0.5, 3600.0, "s")
        _check_number("simulation_frequency", self.simulation_frequency, 1.0, 1000.0, "Hz")
        for name, low in (("lanes_count", 1), ("oncoming_lanes_count", 0)):
            count = getattr(self, name)
            if not isinstance(count, int) or isinstance(count, bool) or not low <= count <= 10:
                raise SettingsError(f"{name} must be a whole number in [{low}, 10], got {count!r}")
        if str(self.other_vehicles_type).removeprefix(_BEHAVIOR) not in DRIVERS:
            raise SettingsError(
                f"other_vehicles_type must be one of {DRIVERS}, got {self.other_vehicles_type!r}"
            )
        self._check_lanes()

    def _check_lanes(self) -> None:
        right, left = self.road
        for vehicle in self.traffic:
            if not right < vehicle.y < left:
                raise SettingsError(
                    f"a vehicle must start on the road, y in ({right:g}, {left:g}) m, got {vehicle}"
                )
        types = () if self.random_traffic is None else self.random_traffic.types
        if "oncoming" in types and not self.oncoming_lanes_count:
            raise SettingsError(
                "oncoming random_traffic needs an oncoming_lanes_count of 1 or more"
            )
        if "cut-in" in types and self.lanes_count < 2:
            raise SettingsError(
                f"random_traffic that cuts in needs 2 lanes, got {self.lanes_count}"
            )

    @property
    def road(self) -> tuple[float, float]:
        """Right and left edge of the road, y [m]."""
        count = self.lanes_count + self.oncoming_lanes_count
        return -LANE_WIDTH / 2, (count - 0.5) * LANE_WIDTH

    @property
    def driver(self) -> str:
        """Name of the drivers' class in `highway_env.vehicle.behavior`."""
        return self.other_vehicles_type.removeprefix(_BEHAVIOR)

    def vehicles(self, rng: np.random.Generator, x: float) -> tuple[Obstacle | Driver, ...]:
        """Return the other vehicles of an episode that begins at x [m], fixed traffic first."""
        if self.random_traffic is None:
            return self.traffic
        ahead = [o.x for o in self.traffic if not o.oncoming]
        more = self.random_traffic.draw(rng, max([x, *ahead]), self.lanes_count)
        return (*self.traffic, *more)

    @classmethod
    def of(cls, config: Mapping[str, Any]) -> "OvertakeOptions":
        """Return the scene of a configuration, plain data; missing keys are as in the paper.

        Keys are the fields of this class. A vehicle is {"type": ..., ...} with the fields of
        `Obstacle` ("constant", "braking", "cut-in", "oncoming") or of `Driver` ("idm"); a car is
        one of `CARS`.

        Raises:
            SettingsError: If a key is unknown or a value has the wrong type.
        """
        known = {f.name for f in fields(cls)}
        unknown = sorted(set(config) - known)
        if unknown:
            raise SettingsError(
                f"a scene has unknown keys {unknown}, expected some of {sorted(known)}"
            )
        given = dict(config)
        if isinstance(given.get("car"), str):
            if given["car"] not in CARS:
                raise SettingsError(f"car must be one of {sorted(CARS)}, got {given['car']!r}")
            given["car"] = CARS[given["car"]]()
        if "traffic" in given:
            given["traffic"] = tuple(map(_vehicle, _sequence(given["traffic"], "traffic")))
        for name in ("noise", "x0"):
            if name in given:
                given[name] = tuple(_sequence(given[name], name))
        if isinstance(given.get("random_traffic"), Mapping):
            lists = {k: tuple(v) if isinstance(v, list) else v
                     for k, v in given["random_traffic"].items()}  # fmt: skip
            given["random_traffic"] = _made("random_traffic", RandomTraffic, lists)
        return _made("a scene", cls, given)


def paper_scene() -> dict[str, Any]:
    """Return the configuration of the paper's scene, with all keys."""
    paper = OvertakeOptions()
    (obstacle,) = paper.traffic
    return {f.name: getattr(paper, f.name) for f in fields(paper)} | {
        "car": "kinematic",
        "traffic": [
            {"type": "constant", "x": obstacle.x, "y": obstacle.y, "speed": obstacle.speed}
        ],
        "noise": list(paper.noise),
        "x0": list(paper.x0),
    }


_TYPES: Mapping[str, Callable[..., Obstacle | Driver]] = {
    "constant": Obstacle,
    "braking": partial(Obstacle, deceleration=1.0),
    "cut-in": partial(Obstacle, y=LANE_WIDTH, moves_to=0.0, moves_at=2.0),
    "oncoming": partial(Obstacle, oncoming=True),
    "idm": Driver,
}
assert set(_TYPES) == set(KINDS)


def _vehicle(given: Any) -> Obstacle | Driver:
    if isinstance(given, Obstacle | Driver):
        return given
    if not isinstance(given, Mapping):
        raise SettingsError(
            f'a vehicle must be like {{"type": "constant", "x": 30}}, got {given!r}'
        )
    kind = given.get("type", "constant")
    if kind not in _TYPES:
        raise SettingsError(f"type of a vehicle must be one of {KINDS}, got {kind!r}")
    return _made(f"vehicle {kind!r}", _TYPES[kind], {k: v for k, v in given.items() if k != "type"})


def _made(what: str, make: Callable[..., Made], given: Mapping[str, Any]) -> Made:
    try:
        return make(**given)
    except TypeError as error:
        raise SettingsError(f"{what}: {error}") from error


def _sequence(given: Any, name: str) -> list[Any]:
    if not isinstance(given, list | tuple | np.ndarray):
        raise SettingsError(f"{name} must be a list, got {given!r}")
    return list(given)


def _check_number(name: str, value: Any, low: float, high: float, unit: str) -> None:
    numeric = isinstance(value, int | float) and not isinstance(value, bool)
    if not numeric or not low <= value <= high:
        raise SettingsError(f"{name} must be a number in [{low:g}, {high:g}] {unit}, got {value!r}")
