"""A road with drivers who react to each other, moved by highway-env. Loads highway-env."""

from collections.abc import Sequence

import numpy as np
from highway_env.road.road import Road
from jaxtyping import Float

from prefcal_env.envs.overtake.road.options import OvertakeOptions
from prefcal_env.envs.overtake.road.traffic import Driver, Mover, Obstacle, Track
from prefcal_env.envs.overtake.road.vehicles import CourseVehicle, road_of


class Simulation:
    """A road with all vehicles, on which drivers decide several times per period.

    In a period of T_s they decide and drive n times T_s/n, where n is the smallest number that
    respects the simulation frequency; so every T_s is driven to its end.

    Args:
        options: Options of the scene.
        vehicles: Other vehicles, in order.
        x: Initial state of the ego plant, shape (n_x,).
        rng: Random generator of the episode.
    """

    def __init__(
        self,
        options: OvertakeOptions,
        vehicles: Sequence[Obstacle | Driver],
        x: Float[np.ndarray, " n_x"],
        rng: np.random.Generator,
    ) -> None:
        self._frequency = options.simulation_frequency
        self.road: Road = road_of(options, vehicles, x, rng)
        self._tracks = {i: Track() for i, v in enumerate(vehicles) if isinstance(v, Driver)}
        self.movers: tuple[Mover, ...] = tuple(
            v if isinstance(v, Obstacle) else self._tracks[i] for i, v in enumerate(vehicles)
        )
        self._note(0.0)

    def drive(
        self, x: Float[np.ndarray, " n_x"], u: Float[np.ndarray, " 2"], start: float, end: float
    ) -> None:
        """Drive all vehicles from `start` to `end` [s], ours from its state `x` with `u` held."""
        own, *others = self.road.vehicles
        own.put(x, u)
        for other in others:
            if isinstance(other, CourseVehicle):
                other.put(start)  # exact position, without summing steps
        own.act({"speed": float(u[0]), "steering": -float(u[1]), "acceleration": 0.0})
        n = max(1, int(np.ceil((end - start) * self._frequency - 1e-9)))
        for i in range(n):
            self.road.act()
            self.road.step((end - start) / n)
            self._note(end - (end - start) * (n - 1 - i) / n)

    def _note(self, t: float) -> None:
        self.t = t
        for i, track in self._tracks.items():
            driver = self.road.vehicles[1 + i]
            track.add(t, driver.pose(), driver.velocity_along())
