"""The road and all vehicles as objects of highway-env. Loads highway-env and pygame.

In highway-env y points down and a vehicle's position is its center; in ours the position is the
front end and y points to the left. Only this module converts between them. We find contacts
ourselves, exactly and between two instants (`contact`), and switch off highway-env's own search,
which pushes vehicles apart.
"""

from collections.abc import Sequence
from math import cos, pi, sin
from typing import Any

import numpy as np
from highway_env.road.lane import LineType, StraightLane
from highway_env.road.road import Road, RoadNetwork
from highway_env.vehicle import behavior
from highway_env.vehicle.kinematics import Vehicle
from jaxtyping import Float

from prefcal_env.plants.bicycle import Bicycle
from prefcal_env.plants.plant import Plant

from .options import DRIVERS, OvertakeOptions
from .rules import KEEPING_SPEED, LANE_WIDTH, LENGTH, WIDTH
from .traffic import Driver, Obstacle, upright

OWN, OTHER, CRASHED = (64, 156, 255), (255, 176, 46), (230, 57, 70)
"""Colors of the ego vehicle, of the others, and of the ego vehicle in a collision, RGB."""
OUR_WAY, ONCOMING = ("start", "end"), ("end", "start")
"""Ends of the lanes in our direction and in the other one. Lane 0 is the leftmost one in the
direction of travel."""
_ROAD_START, _ROAD_END = -1e3, 1e5  # m; far beyond any position in an episode
_NONE = np.zeros(0)


def network_of(options: OvertakeOptions) -> RoadNetwork:
    """Return lanes of 4 m: ours rightmost, oncoming ones to the left of all in our direction."""
    network = RoadNetwork()
    solid, dashed, none = LineType.CONTINUOUS_LINE, LineType.STRIPED, LineType.NONE
    ours, all_of_them = options.lanes_count, options.lanes_count + options.oncoming_lanes_count
    right, left = np.array([_ROAD_START, 0.0]), np.array([_ROAD_END, 0.0])
    for n in reversed(range(ours)):
        lines = (solid if n == all_of_them - 1 else dashed, solid if n == 0 else none)
        aside = np.array([0.0, -LANE_WIDTH * n])
        network.add_lane(*OUR_WAY, StraightLane(right + aside, left + aside, LANE_WIDTH, lines,
                                                speed_limit=None))  # fmt: skip
    for n in range(ours, all_of_them):
        lines = (none, solid if n == all_of_them - 1 else dashed)
        aside = np.array([0.0, -LANE_WIDTH * n])
        network.add_lane(*ONCOMING, StraightLane(left + aside, right + aside, LANE_WIDTH, lines,
                                                 speed_limit=None))  # fmt: skip
    return network


class OwnVehicle(Vehicle):  # type: ignore[misc]
    """The ego vehicle: its plant, simulated exactly with the inputs held, for steps of any length.

    An action holds "steering" [rad], to the right as in highway-env, and either "speed" [m/s] or
    "acceleration" [m/s²].
    """

    LENGTH, WIDTH = LENGTH, WIDTH

    def __init__(
        self,
        road: Road,
        position: Sequence[float],
        heading: float = 0.0,
        speed: float = KEEPING_SPEED,
        plant: Plant | None = None,
    ) -> None:
        super().__init__(road, position, heading, speed)
        self.check_collisions, self.color = False, OWN
        self.plant = Bicycle() if plant is None else plant
        self.u = np.array([speed, 0.0])
        self.target_speed = KEEPING_SPEED  # the speed that MOBIL assumes for us
        x, y = self.position
        ahead = np.array([cos(heading), -sin(heading)]) * LENGTH / 2
        self.x = np.array([x + ahead[0], -y + ahead[1], -heading])

    def inputs(self, duration: float) -> Float[np.ndarray, " 2"]:
        """Return v [m/s] and δ_s [rad] that the action stands for in a period of `duration` [s].

        An acceleration changes v by itself times the duration, from one period to the next.
        """
        v = self.action.get("speed", self.u[0] + self.action["acceleration"] * duration)
        return np.array([v, -self.action["steering"]], dtype=float)

    def step(self, dt: float) -> None:
        """Hold the inputs of the action for `dt` [s]; they saturate at the plant's limits."""
        low, high = np.array([(c.low, c.high) for c in self.plant.inputs]).T
        u = np.clip(self.inputs(dt), low, high)
        self.put(self.plant.hold(self.x, u, _NONE, np.array([dt]))[0], u)

    def put(self, x: Float[np.ndarray, " n_x"], u: Float[np.ndarray, " 2"]) -> None:
        """Place it at the plant's state `x`, with the inputs `u` held."""
        self.x, self.u = x, u
        front_x, front_y, turned = x[:3].tolist()
        self.speed = float(u[0])
        _place(self, front_x, front_y, turned, -turned)


class CourseVehicle(Vehicle):  # type: ignore[misc]
    """A vehicle that drives the fixed course of an `Obstacle`."""

    LENGTH, WIDTH = LENGTH, WIDTH

    def __init__(
        self,
        road: Road,
        position: Sequence[float],
        heading: float = 0.0,
        speed: float = 0.0,
        course: Obstacle | None = None,
    ) -> None:
        super().__init__(road, position, heading, speed)
        self.check_collisions, self.color = False, OTHER
        x, y = self.position
        self.course = course or Obstacle(x + LENGTH / 2, -y, speed)
        self.time, self.target_speed = 0.0, self.course.speed

    def step(self, dt: float) -> None:
        """Drive for `dt` [s]."""
        self.put(self.time + dt)

    def put(self, t: float) -> None:
        """Place it where it is at `t` [s]."""
        self.time = t
        at = np.array([t])
        x, y, turned = self.course.poses(at)[0].tolist()
        self.speed = abs(float(self.course.speeds(at)[0]))
        _place(self, x, y, turned, _heading(turned, self.course.oncoming))


class _OfOurs:
    """A mixin that gives highway-env's drivers our size, color and poses."""

    LENGTH, WIDTH = LENGTH, WIDTH

    def start(self: Any, oncoming: bool) -> None:
        """Prepare to drive: no collision checks by highway-env, our color, and the direction."""
        self.check_collisions, self.color, self.oncoming = False, OTHER, oncoming

    def pose(self: Any) -> tuple[float, float, float]:
        """Return the pose, as in `traffic.Mover`."""
        turned = upright(-self.heading)
        x, y = self.position.tolist()
        return x + LENGTH / 2 * cos(turned), -y + LENGTH / 2 * sin(turned), turned

    def velocity_along(self: Any) -> float:
        """Return the speed along the road [m/s], negative if oncoming."""
        return float(self.speed * cos(self.heading))

    def put(self: Any, x: float, y: float, turned: float) -> None:
        """Place it at a pose, as in `traffic.Mover`."""
        _place(self, x, y, turned, _heading(turned, self.oncoming))


class IDM(_OfOurs, behavior.IDMVehicle):  # type: ignore[misc]
    """A driver that follows the intelligent driver model and MOBIL."""


class Linear(_OfOurs, behavior.LinearVehicle):  # type: ignore[misc]
    """A driver whose acceleration is linear in gaps and speeds."""


class Aggressive(_OfOurs, behavior.AggressiveVehicle):  # type: ignore[misc]
    """A linear driver with short gaps."""


class Defensive(_OfOurs, behavior.DefensiveVehicle):  # type: ignore[misc]
    """A linear driver with long gaps."""


_DRIVERS = dict(zip(DRIVERS, (IDM, Linear, Aggressive, Defensive), strict=True))


def road_of(
    options: OvertakeOptions,
    vehicles: Sequence[Obstacle | Driver],
    x: Float[np.ndarray, " n_x"],
    rng: np.random.Generator,
    *,
    record_history: bool = False,
) -> Road:
    """Return a road with all vehicles at the start: ours at the plant's state `x`, then others."""
    road = Road(network_of(options), np_random=rng, record_history=record_history)
    own = OwnVehicle(road, [0.0, 0.0], plant=options.car.plant)
    own.put(x, np.array([KEEPING_SPEED, 0.0]))
    road.vehicles = [own]
    for vehicle in vehicles:
        if isinstance(vehicle, Driver):
            road.vehicles.append(_driver(road, vehicle, options.driver))
        else:
            other = CourseVehicle(road, [0.0, 0.0], course=vehicle)
            other.put(0.0)
            road.vehicles.append(other)
    return road


def _driver(road: Road, driver: Driver, kind: str) -> Any:
    middle = driver.x + (LENGTH if driver.oncoming else -LENGTH) / 2
    found = _DRIVERS[kind](
        road, [middle, -driver.y], heading=_heading(0.0, driver.oncoming), speed=driver.speed,
        target_speed=driver.target_speed, enable_lane_change=driver.changes_lanes,
    )  # fmt: skip
    found.start(driver.oncoming)
    return found


def _heading(turned: float, oncoming: bool) -> float:
    return pi - turned if oncoming else -turned


def _place(vehicle: Any, x: float, y: float, turned: float, heading: float) -> None:
    half = LENGTH / 2
    vehicle.position = np.array([x - half * cos(turned), -(y - half * sin(turned))])
    vehicle.heading = heading
    vehicle.on_state_update()
