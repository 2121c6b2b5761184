"""Which answer carries the result, and what the next one can change."""

from dataclasses import replace

import numpy as np
import pytest

from prefcal_agents.people import DRAWS, Scale, Utilities, overtaking
from prefcal_agents.result import DrawPool, decisive, influences, stakes, turn
from prefcal_env.preferences.answer import Answer, Mark, Preference
from prefcal_env.preferences.history import Comparison, History
from support.histories import in_cube
from support.simulated import bank_of, random_bank

OTHERS = random_bank(60).kpis
POOR, FAIR, GOOD, SAME, BEST = range(5)
BANK = bank_of(
    np.vstack([[[0.9, 0.9, 0.9], [0.5, 0.5, 0.5], [0.2, 0.2, 0.2], [0.2, 0.2, 0.2], [0.1] * 3], OTHERS])
)
SCALE = Scale.of(BANK, np.arange(len(BANK)))


def record(*given, pending=None):
    """A record in which each row is compared with the best so far: (row, answer)."""
    samples = [in_cube(BANK.thetas[row]) for row, _ in given]
    comparisons, best = [], 0
    for index, (_, answer) in enumerate(given):
        rival = best if index else None
        comparisons.append(Comparison(index, rival, Answer.of(answer) if index else Answer(None)))
        best = index if answer == -1 else best
    if pending is not None:
        samples.append(in_cube(BANK.thetas[pending]))
    return History(tuple(samples), tuple(comparisons))


def pool_of(history):
    prior = Utilities.draw(SCALE, 4 * DRAWS, np.random.default_rng(0))
    return DrawPool.of(BANK, SCALE, SCALE(BANK), [(history.until(0), prior), (history, prior)])


def test_a_verdict_that_all_people_would_give_is_less_open_than_one_of_taste():
    history = record((POOR, None), (GOOD, -1), (9, 1), (FAIR, 1))
    found = {each.answer: each for each in influences(pool_of(history), history)}
    assert set(found) == {1, 2, 3}
    assert found[2].chance > 3 * max(found[1].chance, found[3].chance)
    assert found[2].reversed == 2
    named = decisive(tuple(found.values()), 1)
    assert named is not None
    assert named.answer == 2


def test_with_the_answer_that_crowned_the_best_turned_the_one_before_is_the_result():
    history = record((FAIR, None), (9, -1))
    (only,) = influences(pool_of(history), history)
    assert (only.answer, only.reversed) == (1, 0)


def test_the_chance_of_another_answer_follows_from_the_record_without_it():
    history = record((POOR, None), (GOOD, -1), (9, 1), (11, 0), (FAIR, 1))
    marked = history.comparisons[2]
    # Without this answer the sample is not unsafe either, so that nothing says it is worse than the others.
    unsafe = replace(marked, answer=replace(marked.answer, marks=frozenset({Mark.CHALLENGER_UNSAFE})))
    half = replace(history.comparisons[4], answer=Answer(Preference.INCUMBENT, strength=0.5))
    history = replace(history, comparisons=(*history.comparisons[:2], unsafe, history.comparisons[3], half))
    pool = pool_of(history)
    found = {each.answer: each.chance for each in influences(pool, history)}
    for answer in (1, 2, 4):  # 3 is a tie
        rest, other = history.retracted(answer), turn(history, answer)
        before, after = pool.log_likelihoods([rest, other])
        assert found.pop(answer) == pytest.approx(pool.weights(rest) @ np.exp(after - before), rel=1e-9)
    assert not found


def test_turning_an_answer_twice_changes_nothing():
    history = record((POOR, None), (GOOD, -1), (9, 1))
    once = turn(history, 1)
    assert once.comparisons[1].answer.preference is Preference.INCUMBENT
    assert once.comparisons[2] == history.comparisons[2]
    assert turn(once, 1) == history


@pytest.mark.parametrize(("new", "low", "high"), [(BEST, 0.7, 0.85), (POOR, 0.0, 0.1), (SAME, 0.0, 0.1)])
def test_a_question_matters_if_the_new_one_may_win(new, low, high):
    history = record((FAIR, None), (GOOD, -1), pending=new)
    assert low <= stakes(pool_of(history), history, 1) <= high


def test_only_the_probably_better_overtake_the_winner_of_the_answers():
    history = record((POOR, None), (GOOD, -1), (9, 1))
    assert overtaking(np.array([0.74, 0.0, 0.76]), 0.1, history).tolist() == [0.0, 0.0, 0.76]


def test_the_winner_stays_if_answers_make_it_likelier_that_the_person_hardly_follows_the_kpis():
    history, better = record((POOR, None), (GOOD, -1), (9, 1)), np.array([0.0, 0.0, 1.0])
    before = Utilities.draw(SCALE, 4000, np.random.default_rng(0)).loose.mean()
    assert before == pytest.approx(0.25, abs=0.02)
    assert overtaking(better, 0.24, history).tolist() == better.tolist()
    assert overtaking(better, 0.26, history).tolist() == [0.0, 0.0, 0.0]
