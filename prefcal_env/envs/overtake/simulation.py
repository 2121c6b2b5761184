"""A road with drivers who react to each other, moved by highway-env. Loads highway-env."""

import numpy as np
from highway_env.road.road import Road
from jaxtyping import Float

from prefcal_env.envs.overtake.road.options import OvertakeOptions
from prefcal_env.envs.overtake.road.traffic import Mover, Obstacle, Track
from prefcal_env.envs.overtake.road.vehicles import pose, road_of


class Simulation:
    """A road with all vehicles, on which drivers decide several times per period.

    In a period of T_s they decide and drive n times T_s/n, where n is the smallest number that
    respects the simulation frequency; so every T_s is driven to its end.

    Args:
        options: Options of the scene.
        x: Initial state of the ego plant, shape (3,).
        rng: Random generator of the episode.
    """

    def __init__(
        self, options: OvertakeOptions, x: Float[np.ndarray, " 3"], rng: np.random.Generator
    ) -> None:
        self._frequency = options.simulation_frequency
        self.road: Road = road_of(options, x, rng)
        self._tracks = [Track() for _ in range(options.vehicles_count)]
        self.movers: tuple[Mover, ...] = (Obstacle(), *self._tracks)
        self._note(0.0)

    def drive(
        self, x: Float[np.ndarray, " 3"], u: Float[np.ndarray, " 2"], start: float, end: float
    ) -> None:
        """Drive all vehicles from `start` to `end` [s], ours from its state `x` with `u` held."""
        own, obstacle, *_ = self.road.vehicles
        own.put(x, u)
        obstacle.put(start)  # exact position, without summing steps
        own.act({"speed": float(u[0]), "steering": -float(u[1]), "acceleration": 0.0})
        n = max(1, int(np.ceil((end - start) * self._frequency - 1e-9)))
        for i in range(n):
            self.road.act()
            self.road.step((end - start) / n)
            self._note(end - (end - start) * (n - 1 - i) / n)

    def _note(self, t: float) -> None:
        for track, driver in zip(self._tracks, self.road.vehicles[2:], strict=True):
            track.add(t, *pose(driver), float(driver.speed * np.cos(driver.heading)))
