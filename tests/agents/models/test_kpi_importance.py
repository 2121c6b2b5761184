"""Which KPIs stand out: named where the answers follow one, and not where nothing tells."""

import numpy as np
import pytest

from prefcal_agents.models.kpi_importance import Importance
from prefcal_env.preferences.answer import Answer
from prefcal_env.preferences.history import History
from support.histories import in_cube

NAMES = tuple("abcdefgh")


def told(cost, answers, seed):
    """A history of random experiments with eight KPIs, the best so far against a new one each."""
    rng = np.random.default_rng([seed, 7])
    history, best, known = History(), None, None
    for index in range(answers + 1):
        kpis = dict(zip(NAMES, rng.exponential(size=len(NAMES)), strict=True))
        history = history.with_pending(in_cube(rng.random(2)))
        preference = None
        if best is not None:
            preference = cost(kpis, known, rng)
        history = history.with_answer(Answer(preference, outcomes=(kpis, known)), best)
        if best is None or preference == -1:
            best, known = index, kpis
    return history


def minds(*names, slips=0.0):
    """A person who minds the sum of these KPIs, and errs at times."""

    def prefer(new, old, rng):
        sign = int(np.sign(sum(new[n] - old[n] for n in names)))
        return -sign if rng.random() < slips else sign

    return prefer


def coin(new, old, rng):
    return int(rng.choice([-1, 1]))


def named(prefer, answers, seeds=20):
    return [Importance.of(told(prefer, answers, seed)).named for seed in range(seeds)]


@pytest.mark.parametrize("slips", [0.0, 0.05])
def test_the_one_kpi_that_a_person_cares_about_is_named_after_20_answers(slips):
    found = named(minds("c", slips=slips), 20)
    assert np.mean([names == ("c",) for names in found]) >= 0.8
    assert all(names[:1] in ((), ("c",)) for names in found)


def test_it_is_named_in_most_studies_after_15_answers():
    assert np.mean([names == ("c",) for names in named(minds("c"), 15)]) >= 0.5


def test_of_two_that_count_both_are_named_or_neither_and_often_after_50_answers():
    found = named(minds("c", "f"), 50)
    assert np.mean([set(names) == {"c", "f"} for names in found]) >= 0.6
    assert all(set(names) <= {"c", "f"} for names in found)


@pytest.mark.parametrize("answers", [8, 15, 25, 50])
def test_nothing_stands_out_of_tosses_of_a_coin(answers):
    assert sum(names != () for names in named(coin, answers)) <= 1


@pytest.mark.parametrize("answers", [15, 25, 50])
@pytest.mark.parametrize("importance", [NAMES[:5], NAMES])
def test_nothing_stands_out_of_five_or_more_that_count_equally(importance, answers):
    assert sum(names != () for names in named(minds(*importance), answers)) <= 2


def test_the_agreement_is_counted_by_hand():
    history = History()
    pairs = [(None, 0.0, 1.0), (-1, -1.0, 1.0), (1, 0.0, 1.0), (-1, -2.0, 1.0), (1, 5.0, 0.0)]
    best = None
    for index, (preference, a, b) in enumerate(pairs):
        history = history.with_pending(in_cube([0.1 * index]))
        history = history.with_answer(Answer(preference, outcomes=({"a": a, "b": b}, None)), best)
        best = index if preference in (None, -1) else best
    found = Importance.of(history)
    assert found.agreement == {"a": 1.0, "b": pytest.approx((0.5 + 0.5 + 0.5 + 0.0) / 4)}
    assert list(found.agreement) == ["a", "b"]
    assert (found.answers, found.named) == (4, ())


def test_only_what_a_person_sees_is_compared_unless_that_is_less_than_two():
    history = told(minds("c"), 25, 0)
    assert set(Importance.of(history, ("a", "c", "not measured")).agreement) == {"a", "c"}
    assert set(Importance.of(history, ("c",)).agreement) == set(NAMES)


def test_kpis_that_no_answer_tells_apart_are_named_together():
    history = told(minds("c"), 25, 0)
    twins = [
        {**answer.outcomes[0], "z": 3 * answer.outcomes[0]["c"]}
        for answer in (c.answer for c in history.comparisons)
    ]
    again, best = History(), None
    for comparison, kpis in zip(history.comparisons, twins, strict=True):
        again = again.with_pending(history.samples[comparison.challenger])
        answer = Answer(comparison.answer.preference, outcomes=(kpis, None))
        again = again.with_answer(answer, comparison.incumbent)
        best = comparison.challenger
    assert best == 25
    assert Importance.of(again).named == ("c", "z")


def test_without_kpis_or_strict_answers_nothing_can_be_said():
    assert Importance.of(History()) is None
    assert Importance.of(told(lambda *_: 0, 9, 0)) is None
    assert Importance.of(told(lambda *_: None, 9, 0)) is None


def test_too_few_answers_name_nothing():
    assert Importance.of(told(minds("c"), 4, 1)).named == ()


def test_missing_and_infinite_kpis_are_taken():
    history, values = History(), [0.0, np.inf, 1.0, np.inf, 2.0, 3.0, np.inf]
    for index, value in enumerate(values):
        history = history.with_pending(in_cube([0.1 * index]))
        kpis = {"late": value} if index % 2 else {"late": value, "odd": float(index)}
        history = history.with_answer(
            Answer(1 if index else None, outcomes=(kpis, None)), 0 if index else None
        )
    found = Importance.of(history)
    assert found.agreement["late"] == 1.0


def test_a_single_kpi_does_not_stand_out_of_tosses_of_a_coin():
    found = []
    for seed in range(10):
        history = told(coin, 15, seed)
        one = History()
        for c in history.comparisons:
            known = {"a": c.answer.outcomes[0]["a"]}
            answer = Answer(c.answer.preference, outcomes=(known, None))
            one = one.with_pending(history.samples[c.challenger]).with_answer(answer, c.incumbent)
        found.append(Importance.of(one).named)
    assert sum(names != () for names in found) <= 1
