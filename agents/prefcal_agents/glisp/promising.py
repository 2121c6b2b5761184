"""Propose the θ that promises most to a person who judges by KPIs."""

import numpy as np
from jaxtyping import Float

from prefcal_agents.acquisition.penalty import Penalty
from prefcal_agents.optimize.search import Tried
from prefcal_agents.space.feasible import random_points
from prefcal_agents.utility.choice import expected_best
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.preferences.history import History

from .kpi_fit import KPIFit

_ANYWHERE, _NEAR = 300, 300
"""Number of random θ to choose from, and of steps from the best one so far."""
_STEPS = (0.003, 0.3)
"""Shortest and longest standard deviation of a step, in units of the cube."""
_MOVED = 0.2
"""Smallest share of the knobs that a step moves; the largest is 1."""


def most_promising(
    space: KnobSpace,
    history: History,
    fit: KPIFit,
    penalty: Penalty | None,
    rng: np.random.Generator,
) -> Float[np.ndarray, " n"]:
    """Return the point of the cube to run next, shape (n,): the best one for `expected_best`.

    Source: Z. J. Lin et al., "Preference exploration for efficient Bayesian optimization with
    multiple outcomes" (2022): a process for each KPI, draws of what the person wants.
    Deviation: draws follow `Utilities`, and the choice is that of `Screening`. The θ to choose from
    are random ones and steps from the best one, as in an evolution strategy.

    Args:
        space: Knobs to tune.
        history: Samples and answers.
        fit: What is known about the person.
        penalty: Penalty for places that are likely unsafe; those with one come last.
        rng: Generator of the θ to choose from, and of the draws.
    """
    samples = history.samples
    best = samples[history.incumbent or 0]
    points = np.vstack([random_points(space, _ANYWHERE, rng), _steps(space, best.z, rng)])
    points = space.snap_all(points)
    points = points[np.atleast_1d(space.allows(space.decode_all(points)))]
    value = expected_best(fit.costs(points, rng), fit.row(best.theta))[len(fit.kept) :]
    risk = np.zeros(len(points)) if penalty is None else penalty(points)
    ranked = points[np.lexsort((-value, risk))]
    tried = Tried(space, history)
    found = tried.first_new(ranked)
    return tried.fresh(ranked[0], rng) if found is None else found


def _steps(
    space: KnobSpace, best: tuple[float, ...], rng: np.random.Generator
) -> Float[np.ndarray, "s n"]:
    """Return steps from the best θ of all lengths, which move some of the knobs, shape (s, n)."""
    shape = (_NEAR, len(space))
    moved = rng.random(shape) < rng.uniform(_MOVED, 1.0, (_NEAR, 1))
    moved[np.arange(_NEAR), rng.integers(0, len(space), _NEAR)] = True
    shortest, longest = np.log(_STEPS)
    length = np.exp(rng.uniform(shortest, longest, (_NEAR, 1)))
    low, high = space.corners
    return np.asarray(np.clip(best + length * moved * rng.standard_normal(shape), low, high))
