"""Whether KPIs explain the answers, and when it is the turn of a proposal without them."""

from dataclasses import replace

import numpy as np
import pytest

from prefcal_agents.agent import one_thread
from prefcal_agents.people import Lessons, Posterior, Scale, Utilities, explains
from prefcal_agents.screening.agent import is_stalled
from prefcal_env.preferences.history import History
from support.simulated import bank_of, in_chain, random_bank

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


THETAS = bank_of(np.ones((401, 1))).thetas
LARGE = bank_of(np.column_stack([0.1 + THETAS, 0.1 + np.random.default_rng(0).random(401)]))


def explained(wanted, count):
    """Whether KPIs explain `count` answers by the costs `wanted`, each row compared with the best before."""
    best = [int(np.argmin(wanted[:row])) for row in range(1, count + 1)]
    answers = np.sign(wanted[1 : count + 1] - wanted[best]).astype(int).tolist()
    record, scale = in_chain(LARGE, range(count + 1), answers), Scale.of(LARGE, np.arange(401))
    comparisons = [replace(c, incumbent=b) for c, b in zip(record.comparisons[1:], best, strict=True)]
    record = replace(record, comparisons=(record.comparisons[0], *comparisons))
    rng, lessons = np.random.default_rng(1), Lessons.of(LARGE, scale, record)
    with one_thread():
        given = Posterior.of(Utilities.draw(scale, 128, rng), lessons.first(0))
        for known in range(50, count + 1, 50):
            given = given.update(lessons.first(known), scale, rng)
        return explains(record, given)


@pytest.mark.parametrize("kpi", [0, 1])
@pytest.mark.parametrize("count", [150, 400])
def test_kpis_explain_a_long_study_of_someone_who_follows_one_without_error(count, kpi):
    # θ says all there is to say of these two KPIs, but only of the latest hundred experiments.
    assert explained(LARGE.kpis[:, kpi], count)


def test_they_do_not_explain_a_long_study_of_someone_who_judges_by_theta():
    assert not explained(np.sum((THETAS - [0.3, 0.8]) ** 2, axis=1), 400)


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
