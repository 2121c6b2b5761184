"""What other answers would teach, from draws that were made given these."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from prefcal_agents.people import DRAWS, Lessons, Posterior, Scale, Utilities
from prefcal_agents.result import DrawPool, turn
from prefcal_env.preferences.history import History
from support.simulated import in_chain, random_bank

BANK = random_bank()
SCALE = Scale.of(BANK, np.arange(len(BANK)))
LOGS = SCALE(BANK)
ROWS = np.random.default_rng(3).permutation(len(BANK))[:8].tolist()
WANTED = LOGS @ [10.0, 1.0, 0.1]


def by_first(wanted=WANTED):
    """The record of somebody who cares most about the first KPI."""
    answers = [int(np.sign(wanted[new] - wanted[old])) for old, new in itertools.pairwise(ROWS)]
    return in_chain(BANK, ROWS, answers)


def learned(record, seed=0):
    """Draws before and after each answer of the record."""
    rng = np.random.default_rng(seed)
    utilities, before, given = Utilities.draw(SCALE, DRAWS, rng), History(), []
    for count in range(record.answered + 1):
        past = record.until(count)
        if past.lessons:
            old, new = (Lessons.of(BANK, SCALE, part) for part in (before, past))
            utilities = Posterior.of(utilities, old).update(new, SCALE, rng).utilities
        given.append((past, utilities))
        before = past
    return given


@pytest.fixture(scope="module")
def record():
    return by_first()


@pytest.fixture(scope="module")
def pool(record):
    return DrawPool.of(BANK, SCALE, LOGS, learned(record))


def costs_of(pool):
    """Costs of the rows shown in each draw."""
    return pool.utilities.costs(LOGS[ROWS])


def better(costs, weights):
    """How probably each row shown is noticeably better than each other one."""
    return np.einsum("s,sij->ij", weights, costs[:, :, None] < costs[:, None] - 1.0)


def test_without_answers_it_weighs_as_people_are_before_any(pool):
    weights = pool.weights(History())
    assert weights @ (pool.utilities.ordered > 0) == pytest.approx(0.5, abs=0.05)
    assert np.allclose(pool.weights(by_first(), 0.0), weights)


@pytest.mark.parametrize("index", [None, 1, 4, 7])
def test_it_agrees_with_learning_again(pool, record, index):
    other = record if index is None else turn(record, index)
    fresh = learned(other, seed=1)[-1][1].costs(LOGS[ROWS])
    again = better(fresh, np.full(len(fresh), 1 / len(fresh)))
    assert np.abs(better(costs_of(pool), pool.weights(other)) - again).mean() < 0.06


def test_a_power_of_a_half_is_less_sure(pool, record):
    sure, less = (better(costs_of(pool), pool.weights(record, power)) for power in (1.0, 0.5))
    assert np.abs(less - less.T).mean() < np.abs(sure - sure.T).mean()


def test_likely_draws_come_several_times_and_the_same_ones_each_time(pool, record):
    drawn = pool.drawn(record, 500)
    assert len(drawn) == 500
    costs, weights = drawn.costs(LOGS[ROWS]), np.full(500, 1 / 500)
    assert np.abs(better(costs, weights) - better(costs_of(pool), pool.weights(record))).max() < 0.05
    assert np.array_equal(drawn.normals, pool.drawn(record, 500).normals)


def test_of_a_record_only_what_differs_from_that_of_the_study_is_worked_out(pool, record, monkeypatch):
    anew, counted = replace(pool, told=pool.told.first(0), likely=np.zeros(len(pool.likely))), []
    records = [record, turn(record, 4), record.retracted(2), record.until(7)]
    expected = anew.log_likelihoods(records)
    of = Posterior.of
    monkeypatch.setattr(Posterior, "of", lambda u, told: (counted.append(len(told)), of(u, told))[1])
    for each, true, most in zip(records, expected, (0, 2, 1, 1), strict=True):
        assert pool.log_likelihoods([each])[0] == pytest.approx(true, abs=1e-9)
        assert {*counted} == {most}
        counted.clear()
