"""What a person wanted, as statements that hold for the person who answered."""

from dataclasses import replace

import numpy as np
import pytest

from prefcal_agents.utility.pool import Pool
from prefcal_agents.utility.posterior import DRAWS, Lessons, updated
from prefcal_agents.utility.utilities import Scale, Utilities
from prefcal_agents.utility.wishes import deciding, objections, pairs, wishes
from prefcal_env.preferences.history import History
from support.simulated import of_pairs, random_bank

BANK = random_bank(200)
ROWS = np.arange(len(BANK))
SCALE = Scale.of(BANK, ROWS)
LOGS = SCALE(BANK)


def taught(kpi, count=20):
    """The pool after answers of somebody who looks at one KPI only, and the record."""
    some = np.random.default_rng(1).permutation(ROWS)[: 2 * count].reshape(-1, 2).tolist()
    values = BANK.kpis[:, kpi]
    record = of_pairs(BANK, some, [int(np.sign(values[new] - values[old])) for old, new in some])
    rng = np.random.default_rng(0)
    before = Utilities.drawn(SCALE, DRAWS, rng)
    lessons = [Lessons.of(BANK, SCALE, part) for part in (History(), record)]
    after = updated(before, *lessons, SCALE, rng)
    return Pool.of(BANK, SCALE, LOGS, [(History(), before), (record, after)]), record


@pytest.mark.parametrize("kpi", range(3))
def test_the_kpi_that_decided_all_answers_is_named_first(kpi):
    pool, record = taught(kpi)
    result = int(np.argsort(BANK.kpis[:, kpi])[10])
    first, *later = wishes(pool, record, ROWS, result)
    assert first.name == "abc"[kpi]
    assert first.first > 0.8
    assert first.certainty >= 0.8
    assert first.bound is not None
    assert first.bound > BANK.kpis[result, kpi]
    assert len(later) <= 2


def test_a_surer_bound_is_a_farther_one():
    pool, record = taught(0)
    result = int(np.argmin(BANK.kpis[:, 0]))
    bound = next(wish.bound for wish in wishes(pool, record, ROWS, result) if wish.name == "a")
    draws = pool.drawn(record, 1024, 0.5)

    def noticed(value):
        logs = np.repeat(LOGS[[result]], 2, axis=0)
        logs[1, 0] = np.log(value - SCALE.good[0])
        return np.mean(draws.gains(draws.levels(logs), np.array([0]), np.array([1])).sum(axis=0) > 1.0)

    assert noticed(bound) >= 0.8
    assert noticed(bound) >= noticed((bound + BANK.kpis[result, 0]) / 2)


def test_nothing_is_said_without_answers():
    pool, _ = taught(0, count=1)
    assert wishes(pool, History(), ROWS, 0) == ()


def test_the_last_one_is_followed_by_none():
    pool, record = taught(1)
    assert wishes(pool, record, ROWS, 0)[-1].first == 1.0


def test_a_kpi_that_a_draw_does_not_look_at_decides_nothing():
    pool, record = taught(2)
    draws = pool.drawn(record, 200)
    alone = draws.take(np.flatnonzero(draws.ordered == 1))
    share = deciding(alone, LOGS, ROWS)
    assert np.array_equal(np.argmax(share, axis=1), np.argmax(alone.normals, axis=1))
    assert np.count_nonzero(share, axis=1).max() == 1


def test_pairs_are_of_different_rows():
    first, second = pairs(ROWS)
    assert len(first) == 200
    assert (first != second).all()
    assert len(pairs(ROWS[:3])[0]) == 3


def test_an_objection_asks_about_what_gains_in_that_kpi_and_was_not_shown():
    pool, record = taught(0)
    result = int(np.argsort(BANK.kpis[:, 0])[10])
    asked = objections(pool, record, ROWS, result, "a")
    assert set(asked) <= {"b", "c"}
    assert asked
    for name, row in asked.items():
        kpi = "abc".index(name)
        assert BANK.kpis[row, kpi] < BANK.kpis[result, kpi]
        assert row not in pool.shown


def test_nobody_can_object_with_a_kpi_in_which_the_result_is_the_best():
    pool, record = taught(0)
    result = int(np.argmin(BANK.kpis[:, 1]))
    assert "b" not in objections(pool, record, ROWS, result, "a")


def test_a_bound_that_no_shown_run_exceeds_is_not_said():
    pool, record = taught(0)
    result = int(np.argmin(BANK.kpis[:, 0]))
    bounds = {wish.name: wish.bound for wish in wishes(pool, record, ROWS, result)}
    assert bounds["a"] is not None
    assert bounds["a"] <= BANK.kpis[pool.shown, 0].max()
    values = pool.bank.kpis.copy()
    values[pool.shown, 0] = values[result, 0]  # nobody saw it vary
    unseen = replace(pool, bank=replace(BANK, kpis=values))
    assert "a" not in {wish.name for wish in wishes(unseen, record, ROWS, result)}
