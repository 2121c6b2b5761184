"""What acts on a loop in one experiment, and what a law or a controller in Python does there."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Float, Int

from prefcal_env.experiments.control import Controller, Measurement

from ._simulate import advance, simulate
from .plants import Plant, packed


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """A loop at rest, and what acts on it at the K instants of the simulation."""

    plant: Plant  # plant of the loop
    x0: Float[np.ndarray, " n_x"]  # state at the start, shape (n_x,)
    u0: Float[np.ndarray, " n_u"]  # inputs at the start, shape (n_u,)
    limits: Float[np.ndarray, "n_u 2"]  # lowest and highest value of each input, shape (n_u, 2)
    safe: Float[np.ndarray, "n_x 2"]  # lowest and highest safe value of each state, shape (n_x, 2)
    measured: Int[np.ndarray, " n_m"]  # indices of the measured states, shape (n_m,)
    reference: Float[np.ndarray, "K n_m"]  # references of the measured states, shape (K, n_m)
    disturbance: Float[np.ndarray, "K n_d"]  # disturbances, shape (K, n_d)
    noise: Float[np.ndarray, "K n_m"]  # noise of the measured states, shape (K, n_m)
    step: float  # step of the simulation, in the loop's unit of time
    hold: int  # steps in a sampling period
    delay: int  # steps of dead time of the inputs
    # Stiction, backlash, resolution and lowest position of each input, shape (n_u, 4); (0, 4)
    # for ideal ones. A controller in Python takes them for ideal
    actuators: Float[np.ndarray, "m 4"] = field(default_factory=lambda: np.zeros((0, 4)))
    # Distance of the values that each measured state can have, shape (n_m,), 0 for continuous
    # ones; (0,) if all are. A controller in Python takes them for continuous
    resolution: Float[np.ndarray, " p"] = field(default_factory=lambda: np.zeros(0))

    @property
    def T_s(self) -> float:
        """Sampling time, in the loop's unit of time."""
        return self.hold * self.step


@dataclass(frozen=True, slots=True, eq=False)
class Trace:
    """States and inputs of an experiment until it stopped, and the N steps of its controller."""

    x: Float[np.ndarray, "V n_x"]  # states, shape (V, n_x), finite
    u: Float[np.ndarray, "V n_u"]  # inputs, shape (V, n_u)
    iterations: Int[np.ndarray, " N"]  # solver iterations of each step, shape (N,)
    solve_time: Float[np.ndarray, " N"]  # duration of each step, s, shape (N,)
    solved: Bool[np.ndarray, " N"]  # whether each step's problem was solved, shape (N,)

    @classmethod
    def nothing(cls, n_x: int, n_u: int) -> "Trace":
        """Return no states and no steps: there was no controller."""
        none = np.zeros(0)
        x, u = np.zeros((0, n_x)), np.zeros((0, n_u))
        return cls(x, u, none.astype(np.int64), none, none.astype(np.bool_))


def by_law(law: int, gains: Float[np.ndarray, "r c"], course: Course) -> Trace:
    """Return what a compiled law with these gains does."""
    x, u, valid = simulate(
        (*packed(course.plant), course.measured),
        (law, gains, course.actuators, course.resolution),
        (course.reference, course.disturbance, course.noise),
        (course.step, course.hold, course.delay),
        (course.x0, course.u0, course.safe),
    )
    steps = len(range(0, max(valid - 1, 0), course.hold))  # the last instant decides none
    return Trace(x[:valid], u[:valid], np.zeros(steps, np.int64), np.zeros(steps), np.ones(steps, np.bool_))


def by_controller(
    controller: Controller, course: Course, clock: Callable[[], float] = time.perf_counter
) -> Trace:
    """Return what `controller` does; where it does not solve its problem, the input is held.

    Args:
        controller: Controller with the sampling time of `course`.
        course: What acts on the loop.
        clock: Returns the time in seconds; only for the duration of the steps.
    """
    plant, count = packed(course.plant), len(course.reference)
    x, u = np.zeros((count, len(course.x0))), np.zeros((count, len(course.u0)))
    x[0], now, valid = course.x0, course.u0, 1
    steps: list[tuple[int, float, bool]] = []
    for k in range(0, count - 1, course.hold):
        seen = course.x0.copy()  # states that are not measured have their first value
        seen[course.measured] = x[k, course.measured] + course.noise[k]
        measurement = Measurement(k * course.step, seen, now, np.zeros(0), course.reference[k])
        start = clock()
        move = controller.move(measurement)
        took = clock() - start
        usable = move.solved and bool(np.isfinite(move.u).all())
        if usable:
            now = np.clip(move.u, course.limits[:, 0], course.limits[:, 1])
        steps.append((move.iterations, took, usable))
        last = min(k + course.hold, count - 1)
        u[k : last + 1] = now
        valid, stopped = advance(
            plant, course.step, course.delay, (k, last), (x, u, course.u0, course.disturbance), course.safe
        )
        if stopped:
            break
    iterations, solve_time, solved = zip(*steps, strict=True)
    return Trace(x[:valid], u[:valid], np.array(iterations), np.array(solve_time), np.array(solved))
