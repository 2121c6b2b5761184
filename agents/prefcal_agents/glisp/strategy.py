"""Propose GLISp's next sample: the table of what is minimized when, and the search."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from prefcal_agents.acquisition.exploration import Acquisition
from prefcal_agents.acquisition.penalty import POOL, Penalized, Penalty, replaced, unsafe_penalty
from prefcal_agents.history.lessons import cube_of
from prefcal_agents.models.gaussian_process import PreferenceGP
from prefcal_agents.optimize.search import Objective, Tried, new_minimum
from prefcal_agents.space.design import latin_hypercube
from prefcal_agents.space.feasible import random_points
from prefcal_env.preferences.history import History

from .kpi_fit import most_promising
from .noise_test import ALMOST_SURE
from .selection import Fit, is_process_turn, train
from .settings import GLISpSetup


class StrategyRow(NamedTuple):
    """One row of the strategy.

    Args:
        holds: Function that returns whether the row applies to a fit in a study.
        objective: Function that trains a model, and returns what the next sample minimizes of it.
    """

    holds: Callable[[GLISpSetup, Fit], bool]
    objective: Callable[[GLISpSetup, Fit], Objective]


def _every_second_time(setup: GLISpSetup, fit: Fit) -> bool:
    turn = is_process_turn(fit.data.history.answered, setup.n_init)
    return setup.settings.process and fit.data.is_strict and turn


def _mean(setup: GLISpSetup, fit: Fit) -> Objective:
    """Return the mean of a Gaussian process trained on comparisons only."""
    # With one comparison per sample, answers cannot contradict each other; with more they can.
    trusted = ALMOST_SURE if fit.data.history.follow_ups else 0.0
    error_rate = setup.settings.error_rate if fit.selection.is_noisy else trusted
    return Acquisition.of(PreferenceGP.of(fit.data.preferences, error_rate), 0.0)


def _exploration(setup: GLISpSetup, fit: Fit) -> Objective:
    """Return eq. acquisition on Ĵ."""
    surrogate = train(fit.data, fit.selection, setup.settings)
    return Acquisition.of(surrogate, setup.settings.delta, cube_of(fit.data.history))


STRATEGY = (StrategyRow(_every_second_time, _mean), StrategyRow(lambda setup, fit: True, _exploration))
"""What the next sample minimizes without KPIs: the first row that holds.

Deviation: the paper has the last row only.
"""


def propose(setup: GLISpSetup, fit: Fit) -> Float[np.ndarray, " n"]:
    """Return the cube point of the next sample, shape (n,): a minimum of an acquisition.

    Source: eq. xNp1.
    Deviation: `most_promising` if KPIs explain the answers, otherwise `STRATEGY`; unsafe marks add
    to the acquisition, see `Penalized`.
    """
    history = fit.data.history
    rng = np.random.default_rng([setup.seed, history.answered])
    penalty = _penalty(setup, history)
    if fit.kpis is not None:
        return most_promising(setup.space, history, fit.kpis, penalty, rng)
    rule = next(rule for rule in STRATEGY if rule.holds(setup, fit))
    objective = rule.objective(setup, fit)
    if penalty is not None:
        objective = Penalized(objective, penalty)
    return new_minimum(objective, setup.space, history, rng)


def propose_start(setup: GLISpSetup, history: History) -> Float[np.ndarray, " n"]:
    """Return the cube point of a sample of the start, shape (n,), from a Latin hypercube.

    Deviation: another point takes its place if it is likely unsafe according to the marks.
    """
    index = history.answered
    rng = np.random.default_rng([setup.seed, index])
    plan = latin_hypercube(setup.space, setup.n_init, setup.seed)
    z = np.asarray(plan[index])
    penalty = _penalty(setup, history)
    if penalty is not None:
        others = np.vstack([cube_of(history), plan[index + 1 :]])
        z = replaced(z, others, random_points(setup.space, POOL, rng), penalty)
    return Tried(setup.space, history).fresh(z, rng)


def _penalty(setup: GLISpSetup, history: History) -> Penalty | None:
    if not history.unsafe():
        return None
    return unsafe_penalty(history, setup.settings.unsafe_weight, setup.settings.least_safe)
