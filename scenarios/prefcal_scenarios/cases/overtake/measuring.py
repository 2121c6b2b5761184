"""Time the car's MPC on this machine, for a `Processor` of it."""

import time
from collections.abc import Callable, Iterable

import numpy as np
from jaxtyping import Float

from prefcal_env.envs.overtake import OvertakeEnv
from prefcal_env.envs.overtake.road.rules import Phase
from prefcal_env.errors import SettingsError
from prefcal_env.experiments.control import Controller, Measurement, Move
from prefcal_env.experiments.rollout import rollout
from prefcal_env.mpc.computation import StepSize
from prefcal_env.mpc.processors import TimedStep
from prefcal_env.plants.bicycle import Bicycle

from .controller import controller, mpc_settings
from .scene import phase_at_control

TIMED = tuple(
    (T_s, share, N_p, 0.261, 0.918)
    for T_s in (0.085, 0.4)
    for share in (0.1, 0.31, 0.65, 1.0)
    for N_p in (10.0, 16.0, 30.0)
)
"""The θ to time: problems of 3 to 61 variables."""
WARM_UP = 3
"""Number of first steps of a run that are not counted."""
Track = Callable[[Iterable[tuple[float, ...]]], Iterable[tuple[float, ...]]]


class Timed:
    """A controller that repeats every step on twins and keeps the shortest time.

    Args:
        twins: Equal controllers, one or more.
        clock: Clock in seconds.
    """

    def __init__(
        self, twins: list[Controller], clock: Callable[[], float] = time.perf_counter
    ) -> None:
        self.twins, self.T_s, self.seconds = twins, twins[0].T_s, list[float]()
        self._clock = clock

    def move(self, measurement: Measurement) -> Move:
        """Decide with every twin, and keep the shortest time."""
        shortest = np.inf
        for twin in self.twins:
            start = self._clock()
            move = twin.move(measurement)
            shortest = min(shortest, self._clock() - start)
        self.seconds.append(shortest)
        return move


def timed_steps(
    rounds: int,
    track: Track = iter,
    clock: Callable[[], float] = time.perf_counter,
) -> list[TimedStep]:
    """Time every step of closed-loop runs of the car over small and large problems.

    Args:
        rounds: Number of times to time each step, 1 or more; the shortest time counts.
        track: Function that wraps the θ to show progress.
        clock: Clock in seconds.

    Raises:
        SettingsError: If `rounds` is below 1.
    """
    if rounds < 1:
        raise SettingsError(f"rounds must be 1 or more, got {rounds}")
    return [s for theta in track(TIMED) for s in _steps(np.array(theta), rounds, clock)]


def _steps(
    theta: Float[np.ndarray, " 5"], rounds: int, clock: Callable[[], float]
) -> list[TimedStep]:
    timed = Timed([controller(theta) for _ in range(rounds)], clock)
    experiment = rollout(OvertakeEnv(), timed, theta)
    sizes = {p: StepSize.of(Bicycle(), mpc_settings(theta, p)) for p in Phase}
    steps = zip(phase_at_control(experiment), experiment.iterations, timed.seconds, strict=True)
    return [TimedStep(sizes[Phase(p)], int(n), t) for p, n, t in steps][WARM_UP:]
