"""What acts on a loop in one experiment, and the states and inputs that result."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Float, Int

from ._simulate import simulate
from .plants import Plant, parameters_of


@dataclass(frozen=True, slots=True, eq=False)
class OperatingPoint:
    """Where a loop starts, and what its inputs allow.

    Args:
        plant: Plant of the loop.
        x: State, shape (n_x,).
        u: Inputs, shape (n_u,).
        d: Disturbance, shape (n_d,).
        limits: Lowest and highest value of each input, shape (n_u, 2).
    """

    plant: Plant
    x: Float[np.ndarray, " n_x"]
    u: Float[np.ndarray, " n_u"]
    d: Float[np.ndarray, " n_d"]
    limits: Float[np.ndarray, "n_u 2"]


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """What acts on a loop at the K instants of the simulation.

    Args:
        at: Where the loop starts.
        measured: Indices of the measured states, shape (n_m,).
        reference: References of the measured states, shape (K, n_m).
        disturbance: Disturbances, shape (K, n_d).
        noise: Noise of the measured states, shape (K, n_m).
        safe: Lowest and highest safe value of each state, shape (n_x, 2).
        step: Step of the simulation, in the loop's unit of time.
        hold: Steps in a sampling period.
        delay: Steps of dead time of the inputs.
        actuators: Stiction, backlash, resolution and lowest position of each input, shape
            (n_u, 4); (0, 4) for ideal ones. An MPC takes them for ideal.
        resolution: Distance of the values that each measured state can have, shape (n_m,), 0 for
            continuous ones; (0,) if all are. An MPC takes them for continuous.
    """

    at: OperatingPoint
    measured: Int[np.ndarray, " n_m"]
    reference: Float[np.ndarray, "K n_m"]
    disturbance: Float[np.ndarray, "K n_d"]
    noise: Float[np.ndarray, "K n_m"]
    safe: Float[np.ndarray, "n_x 2"]
    step: float
    hold: int
    delay: int
    actuators: Float[np.ndarray, "m 4"] = field(default_factory=lambda: np.zeros((0, 4)))
    resolution: Float[np.ndarray, " p"] = field(default_factory=lambda: np.zeros(0))

    @property
    def T_s(self) -> float:
        """Sampling time, in the loop's unit of time."""
        return self.hold * self.step


@dataclass(frozen=True, slots=True, eq=False)
class Driven:
    """States and inputs of an experiment until it stopped, and the N steps of its controller.

    Args:
        x: States, shape (V, n_x), finite.
        u: Inputs, shape (V, n_u).
        iterations: Solver iterations of each step, shape (N,).
        solve_time: Duration of each step, s, shape (N,).
        solved: Whether each step's problem was solved, shape (N,).
    """

    x: Float[np.ndarray, "V n_x"]
    u: Float[np.ndarray, "V n_u"]
    iterations: Int[np.ndarray, " N"]
    solve_time: Float[np.ndarray, " N"]
    solved: Bool[np.ndarray, " N"]


def steps_in(valid: int, hold: int) -> int:
    """Return how many inputs were decided in `valid` instants; the last instant decides none."""
    return len(range(0, max(valid - 1, 0), hold))


def by_law(law: int, gains: Float[np.ndarray, "r c"], course: Course) -> Driven:
    """Return what a compiled law with these gains does."""
    at = course.at
    x, u, valid = simulate(
        (at.plant.kind, parameters_of(at.plant), course.measured),
        (law, gains, course.actuators, course.resolution),
        (course.reference, course.disturbance, course.noise),
        (course.step, course.hold, course.delay),
        (at.x, at.u, course.safe),
    )
    steps = steps_in(valid, course.hold)
    return Driven(
        x[:valid], u[:valid], np.zeros(steps, np.int64), np.zeros(steps), np.ones(steps, np.bool_)
    )
