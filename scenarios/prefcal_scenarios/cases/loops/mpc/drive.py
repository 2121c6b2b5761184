"""Let a controller in Python drive a loop, sampling period by sampling period."""

import time
from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from prefcal_env.experiments.control import Controller, Measurement
from prefcal_scenarios.cases.loops._simulate import advance
from prefcal_scenarios.cases.loops.course import Course, Driven
from prefcal_scenarios.cases.loops.plants import parameters_of


def by_controller(
    controller: Controller, course: Course, clock: Callable[[], float] = time.perf_counter
) -> Driven:
    """Return what `controller` does; where it does not solve its problem, the input is held.

    Args:
        controller: Controller with the sampling time of `course`.
        course: What acts on the loop.
        clock: Returns the time in seconds; only for the duration of the steps.
    """
    at, count = course.at, len(course.reference)
    plant = at.plant.kind, parameters_of(at.plant)
    x, u = np.zeros((count, len(at.x))), np.zeros((count, len(at.u)))
    x[0], now, valid = at.x, at.u, 1
    steps: list[tuple[int, float, bool]] = []
    for k in range(0, count - 1, course.hold):
        measurement = _measured(course, k, x[k], now)
        start = clock()
        move = controller.move(measurement)
        took = clock() - start
        usable = move.solved and bool(np.isfinite(move.u).all())
        if usable:
            now = np.clip(move.u, at.limits[:, 0], at.limits[:, 1])
        steps.append((move.iterations, took, usable))
        last = min(k + course.hold, count - 1)
        u[k : last + 1] = now
        valid = advance(
            plant, course.step, course.delay, (k, last),
            (x, u, at.u, course.disturbance), course.safe,
        )  # fmt: skip
        if valid <= last or not _safe(x[last], course.safe):
            break
    iterations, solve_time, solved = zip(*steps, strict=True)
    return Driven(
        x[:valid], u[:valid], np.array(iterations), np.array(solve_time), np.array(solved)
    )


def _measured(
    course: Course, k: int, x: Float[np.ndarray, " n_x"], u: Float[np.ndarray, " n_u"]
) -> Measurement:
    """Return what is known at instant `k`: states that are not measured have their first value."""
    seen = course.at.x.copy()
    seen[course.measured] = x[course.measured] + course.noise[k]
    return Measurement(k * course.step, seen, u, np.zeros(0), course.reference[k])


def _safe(x: Float[np.ndarray, " n_x"], limits: Float[np.ndarray, "n_x 2"]) -> bool:
    """Return whether every state is within its limits."""
    return bool(((limits[:, 0] <= x) & (x <= limits[:, 1])).all())
