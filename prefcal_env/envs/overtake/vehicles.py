"""The road and all vehicles as objects of highway-env, which moves drivers. Loads highway-env.

In highway-env y points down and a vehicle's position is its center; in ours the position is the
front end and y points to the left. Only this module converts between them. We find contacts
ourselves, exactly and between two instants (`first_contact`), and switch off highway-env's own search,
which pushes vehicles apart.
"""

from math import cos, sin
from typing import Any

import numpy as np
from highway_env.road.lane import LineType, StraightLane
from highway_env.road.road import Road, RoadNetwork
from highway_env.utils import class_from_path
from highway_env.vehicle.kinematics import Vehicle
from jaxtyping import Float

from prefcal_env.plants.bicycle import Bicycle

from .scene import (
    HIGH,
    KEEPING_SPEED,
    LANE_WIDTH,
    LENGTH,
    LOW,
    OBSTACLE_SPEED,
    OVERTAKING_SPEED,
    WIDTH,
    Obstacle,
    OvertakeOptions,
    Places,
    Times,
)

OWN, OTHER, CRASHED = (64, 156, 255), (255, 176, 46), (230, 57, 70)
"""Colors of the ego vehicle, of the others, and of the ego vehicle in a collision, RGB."""
_PLANT, _NONE = Bicycle(), np.zeros(0)


def network_of(options: OvertakeOptions) -> RoadNetwork:
    """Return the lanes of 4 m, ours rightmost, with a speed limit of 60 km/h for drivers."""
    network = RoadNetwork()
    solid, dashed, none = LineType.CONTINUOUS_LINE, LineType.STRIPED, LineType.NONE
    for n in reversed(range(options.lanes_count)):
        lines = (solid if n == options.lanes_count - 1 else dashed, solid if n == 0 else none)
        # m; far beyond any position in an episode
        ends = np.array([[x, -LANE_WIDTH * n] for x in (-1e3, 1e5)])
        lane = StraightLane(*ends, LANE_WIDTH, lines, speed_limit=OVERTAKING_SPEED)
        network.add_lane("start", "end", lane)
    return network


class OwnVehicle(Vehicle):  # type: ignore[misc]
    """The ego vehicle: its plant, simulated exactly with the inputs held, for steps of any length.

    An action holds "steering" [rad], to the right as in highway-env, and either "speed" [m/s] or
    "acceleration" [m/s²].
    """

    LENGTH, WIDTH = LENGTH, WIDTH

    def __init__(self, road: Road, x: Float[np.ndarray, " 3"]) -> None:
        super().__init__(road, [0.0, 0.0])
        # Contacts are found in `first_contact`: highway-env would push the bodies apart.
        self.check_collisions, self.color = False, OWN
        self.target_speed = KEEPING_SPEED  # the speed that MOBIL assumes for us
        self.put(x, np.array([KEEPING_SPEED, 0.0]))

    def inputs(self, duration: float) -> Float[np.ndarray, " 2"]:
        """Return v [m/s] and δ_s [rad] that the action stands for in a period of `duration` [s].

        An acceleration changes v by itself times the duration, from one period to the next.
        """
        v = self.action.get("speed", self.u[0] + self.action["acceleration"] * duration)
        return np.array([v, -self.action["steering"]], dtype=float)

    def step(self, dt: float) -> None:
        """Hold the inputs of the action for `dt` [s]; they saturate at the plant's limits."""
        u = np.clip(self.inputs(dt), LOW, HIGH)
        # By our plant, not by highway-env's Euler steps: the path must not depend on the step.
        self.put(_PLANT.hold(self.x, u, _NONE, np.array([dt]))[0], u)

    def put(self, x: Float[np.ndarray, " 3"], u: Float[np.ndarray, " 2"]) -> None:
        """Place it at the plant's state `x`, and let it hold the inputs `u`."""
        self.x, self.u = x, u
        self.speed = float(u[0])
        # Without acceleration, so that a step without a new action holds the speed.
        self.act({"speed": self.speed, "steering": -float(u[1]), "acceleration": 0.0})
        place(self, *x.tolist())


class ObstacleVehicle(Vehicle):  # type: ignore[misc]
    """The paper's obstacle."""

    LENGTH, WIDTH = LENGTH, WIDTH

    def __init__(self, road: Road) -> None:
        super().__init__(road, [0.0, 0.0], speed=OBSTACLE_SPEED)
        self.check_collisions, self.color = False, OTHER
        self.target_speed = OBSTACLE_SPEED
        self.put(0.0)

    def step(self, dt: float) -> None:
        """Drive for `dt` [s]."""
        # From the time, not by adding ways: sums would drift from the obstacle of `scene`.
        self.put(self.time + dt)

    def put(self, t: float) -> None:
        """Place it where it is at `t` [s]."""
        self.time = t
        place(self, *Obstacle().at(np.array([t]))[0, :3].tolist())


def road_of(options: OvertakeOptions, x: Float[np.ndarray, " 3"], rng: np.random.Generator) -> Road:
    """Return a road with all vehicles: ours at the plant's state `x`, the obstacle, drivers."""
    road = Road(network_of(options), np_random=rng)
    road.vehicles = [OwnVehicle(road, x), ObstacleVehicle(road)]
    kind = class_from_path(options.other_vehicles_type)
    for _ in range(options.vehicles_count):
        driver = kind.create_random(road, spacing=1 / options.vehicles_density)
        driver.randomize_behavior()
        # On the object, since the class is shared with all other environments of the process.
        driver.LENGTH, driver.WIDTH = LENGTH, WIDTH
        driver.check_collisions, driver.color = False, OTHER
        road.vehicles.append(driver)
    return road


def pose(vehicle: Vehicle) -> tuple[float, float, float]:
    """Return the pose of a vehicle in our coordinates."""
    (x, y), turned = vehicle.position.tolist(), -float(vehicle.heading)
    # From the center to the front end, half a length ahead.
    return x + LENGTH / 2 * cos(turned), -y + LENGTH / 2 * sin(turned), turned


def place(vehicle: Any, x: float, y: float, turned: float) -> None:
    """Put a vehicle at a pose in our coordinates."""
    half = LENGTH / 2
    vehicle.position = np.array([x - half * cos(turned), -(y - half * sin(turned))])
    vehicle.heading = -turned
    vehicle.on_state_update()


class Track:
    """The path that a driver of highway-env has driven so far, straight between two instants.

    This matches highway-env, which keeps speed and direction constant for a step.
    """

    def __init__(self) -> None:
        self._t: list[float] = []
        self._places: list[tuple[float, float, float, float]] = []

    def add(self, t: float, x: float, y: float, turned: float, speed: float) -> None:
        """Append pose and speed along the road [m/s] at `t` [s]."""
        self._t.append(t)
        self._places.append((x, y, turned, speed))

    def at(self, t: Times) -> Places:
        """Return pose and speed at the times `t` [s], shape (K, 4)."""
        known = np.array(self._places).T
        return np.stack([np.interp(t, self._t, values) for values in known], axis=1)


class Drivers:
    """The drivers on a road, who react to each other; they decide several times per period.

    In a period of T_s they decide and drive n times T_s/n, where n is the smallest number that
    respects the simulation frequency; so every T_s is driven to its end. `x` is the initial state of
    the ego plant.
    """

    def __init__(
        self, options: OvertakeOptions, x: Float[np.ndarray, " 3"], rng: np.random.Generator
    ) -> None:
        self._frequency = options.simulation_frequency
        self.road: Road = road_of(options, x, rng)
        self.tracks = tuple(Track() for _ in range(options.vehicles_count))
        self._note(0.0)

    def drive(self, x: Float[np.ndarray, " 3"], u: Float[np.ndarray, " 2"], start: float, end: float) -> None:
        """Drive all vehicles from `start` to `end` [s], ours from its state `x` with `u` held."""
        own, obstacle, *_ = self.road.vehicles
        own.put(x, u)
        obstacle.put(start)  # exact position, without summing steps
        n = max(1, int(np.ceil((end - start) * self._frequency - 1e-9)))
        for i in range(n):
            self.road.act()
            self.road.step((end - start) / n)
            # Counted back from the end, so that the last note is at the end without rounding.
            self._note(end - (end - start) * (n - 1 - i) / n)

    def _note(self, t: float) -> None:
        for track, driver in zip(self.tracks, self.road.vehicles[2:], strict=True):
            track.add(t, *pose(driver), float(driver.speed * np.cos(driver.heading)))
