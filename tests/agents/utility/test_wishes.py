"""What a person wanted, as statements that hold for the person who answered."""

from dataclasses import replace

import numpy as np
import pytest

from prefcal_agents.people import DRAWS, Lessons, Posterior, Scale, Utilities
from prefcal_agents.result import DrawPool, wishes
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
    before = Utilities.draw(SCALE, DRAWS, rng)
    old, new = [Lessons.of(BANK, SCALE, part) for part in (History(), record)]
    after = Posterior.of(before, old).update(new, SCALE, rng).utilities
    return DrawPool.of(BANK, SCALE, LOGS, [(History(), before), (record, after)]), record


@pytest.mark.parametrize("kpi", range(3))
def test_the_kpi_that_decided_all_answers_is_named_and_what_is_less_sure_is_not(kpi):
    pool, record = taught(kpi)
    result = int(np.argsort(BANK.kpis[:, kpi])[10])
    found = wishes(pool, record, ROWS, result)
    assert set(found) == {"abc"[kpi]}
    certainty, value = found["abc"[kpi]]
    assert 0.8 <= certainty <= 1.0
    assert BANK.kpis[result, kpi] < value <= BANK.kpis[:, kpi].max()


def test_after_one_answer_nothing_is_sure_enough_to_be_said():
    pool, record = taught(0, count=1)
    assert wishes(pool, record, ROWS, int(np.argsort(BANK.kpis[:, 0])[10])) == {}


def test_nothing_is_said_without_answers():
    pool, _ = taught(0, count=1)
    assert wishes(pool, History(), ROWS, 0) == {}


def test_a_kpi_that_nobody_saw_vary_is_not_said():
    pool, record = taught(0)
    result = int(np.argmin(BANK.kpis[:, 0]))
    assert "a" in wishes(pool, record, ROWS, result)
    values = pool.bank.kpis.copy()
    values[pool.shown, 0] = values[result, 0]  # nobody saw it vary
    unseen = replace(pool, bank=replace(BANK, kpis=values))
    assert "a" not in wishes(unseen, record, ROWS, result)
