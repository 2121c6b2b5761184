"""Whether KPIs explain the answers, and when it is the turn of a proposal without them."""

import numpy as np
import pytest

from prefcal_agents.people import Lessons, Posterior, Scale, Utilities, explains
from prefcal_agents.screening.agent import is_stalled
from prefcal_env.preferences.history import History
from support.simulated import in_chain, random_bank

BANK = random_bank(60)  # θ says nothing about these KPIs, nor they about θ
SCALE = Scale.of(BANK, np.arange(len(BANK)))
BY_KPIS = np.log(BANK.kpis) @ [1.0, 0.2, 0.0]
BY_THETA = np.sum((BANK.thetas - [0.3, 0.8]) ** 2, axis=1)


def answered(wanted, count, seed=0):
    """The record of `count` answers by the costs `wanted`, each about two rows in a chain."""
    rows = np.random.default_rng(seed).permutation(len(BANK))[: count + 1]
    return in_chain(BANK, rows.tolist(), np.sign(np.diff(wanted[rows])).astype(int).tolist())


def kpis_explain(record):
    rng = np.random.default_rng(1)
    before = Utilities.draw(SCALE, 256, rng)
    old, new = (Lessons.of(BANK, SCALE, each) for each in (History(), record))
    return explains(record, Posterior.of(before, old).update(new, SCALE, rng))


def test_kpis_explain_someone_who_judges_by_them():
    assert [kpis_explain(answered(BY_KPIS, 20, seed)) for seed in range(4)] == [True] * 4


def test_they_do_not_explain_someone_who_judges_by_theta():
    assert sum(kpis_explain(answered(BY_THETA, 20, seed)) for seed in range(4)) <= 1


def test_fewer_than_ten_answers_and_ties_alone_say_too_little():
    assert kpis_explain(answered(BY_THETA, 9))
    assert kpis_explain(in_chain(BANK, range(13), [0] * 12))
    assert kpis_explain(in_chain(BANK, range(13), [None] * 12))


def chain(answers):
    return in_chain(BANK, range(len(answers) + 1), answers)


@pytest.mark.parametrize(
    ("answers", "expected"),
    [
        ([1] * 11, True),
        ([1] * 10, False),  # every second time
        ([1] * 9, False),  # too few
        ([-1, *[1] * 10], True),
        ([*[1] * 6, -1, *[1] * 4], False),  # one of the last five won
        ([*[1] * 5, -1, *[1] * 5], True),
        ([1, *[0] * 10], True),  # a tie is no win
        ([0] * 11, False),  # nothing is known
        ([*[1] * 10, None], False),  # an abstention is no answer
    ],
)
def test_every_second_time_while_the_last_five_challengers_lost(answers, expected):
    assert is_stalled(chain(answers)) is expected
