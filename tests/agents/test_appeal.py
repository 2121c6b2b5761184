"""Further questions where answers contradict each other: whether the best is the best."""

from dataclasses import replace

import numpy as np
import pytest
from prefcal_agents.appeal import to_appeal
from prefcal_agents.doubt import rows_of
from prefcal_agents.placing import to_place

from prefcal_agents import GLISp, GLISpSettings
from prefcal_agents.history.history import History
from prefcal_agents.models.expectation_propagation import ExpectationPropagation
from prefcal_agents.models.surrogate import Shape
from prefcal_env.knobs.knob import Knob, KnobSpace
from prefcal_env.preferences.answer import Answer, Mark
from support.studies import by, drive

SQUARE = KnobSpace([Knob("x", -1.0, 1.0, step=0), Knob("y", -1.0, 1.0, step=0)])
SHAPE = Shape(1.0, (1.0,))


def line(answers, marks=()):
    """Samples on a line, each compared with the one that is named; marks of the last answer."""
    history = History()
    for k, (rival, answer) in enumerate([(None, None), *answers]):
        given = Answer(answer, marks=marks if k == len(answers) else ())
        history = history.with_pending(np.array([k / 10])).told(given, rival)
    return history


def appealed(history):
    """The pair, Ĵ and what is believed, of a person who errs in 1 of 10 answers."""
    z = history.cube()
    features = SHAPE.basis(z, z)
    belief = ExpectationPropagation.of(rows_of(history.preferences(), SHAPE), 0.1)
    values = features @ belief.mean
    return to_appeal(history, values, features, belief), values, features, belief


def test_the_best_meets_the_rival_of_whom_it_is_least_sure():
    history = line([(0, -1), (0, 1), (0, -1), (0, -1), (2, -1), (5, 1)])
    pair, _, features, belief = appealed(history)
    best = history.incumbent
    met = {c.challenger if c.incumbent == best else c.incumbent for c in history.comparisons
           if best in (c.challenger, c.incumbent)}  # fmt: skip
    covariance = np.linalg.inv(belief.root @ belief.root.T)
    sure = {}
    for k in set(range(7)) - met - {best}:
        row = features[k] - features[best]
        sure[k] = row @ belief.mean / np.sqrt(row @ covariance @ row)
    rival = min(sure, key=sure.__getitem__)
    assert pair == (max(best, rival), min(best, rival))
    assert len(sure) > 2


def test_one_that_is_believed_better_than_the_best_is_asked_about_first():
    """Nine answers say that it gets better to the right, one that 9 lost to 0."""
    history = line([(k - 1, -1) for k in range(1, 9)] + [(8, -1)])
    history = history.told_further(Answer(-1), 0, 9)
    pair, values, features, belief = appealed(history)
    assert history.incumbent == 0
    assert to_appeal(history, values, features, belief, sure=0.0) == pair
    assert values[max(pair)] < values[0]
    sure = line([(0, 1), (0, 1), (0, 1)])
    _, values, features, belief = appealed(sure)
    assert to_appeal(sure, values, features, belief, sure=0.0) is None


def test_whoever_has_met_the_best_is_not_asked_again_and_then_nothing_is():
    history = line([(0, 1), (0, 1), (1, -1)])
    assert appealed(history)[0] == (3, 0)
    history = history.told_further(Answer(1), 3, 0)
    assert appealed(history)[0] is None


@pytest.mark.parametrize("answer", [None, 0])
def test_whoever_cannot_tell_is_not_asked_the_same_again(answer):
    history = line([(0, 1), (0, 1), (1, -1), (1, -1)])
    first = appealed(history)[0]
    told = history.told_further(Answer(answer), *first)
    assert appealed(told)[0] not in (first, None)
    retracted = history.told_further(Answer(1), *first).retracted(0, further=True)
    assert appealed(retracted)[0] not in (first, None)


def test_only_the_nine_next_to_the_best_are_rivals():
    """The first beat ten others; two more were compared with the worst of these only."""
    history = line([(0, 1)] * 10 + [(10, 1), (10, 1)])
    z, values = history.cube(), np.arange(13.0)
    features = SHAPE.basis(z, z)
    belief = ExpectationPropagation.of(rows_of(history.preferences(), SHAPE), 0.1)
    belief = replace(belief, mean=np.zeros(13))  # sure of nothing
    assert to_appeal(history, values, features, belief) is None
    values[12] = 0.5
    assert to_appeal(history, values, features, belief) == (12, 0)


def test_nobody_far_behind_is_asked():
    """That 1 is better than 0 was said five times."""
    history = line([(0, -1), (1, -1)])
    for _ in range(5):
        history = history.told_further(Answer(-1), 1, 0)
        history = history.told_further(Answer(-1), 2, 1)
    pair, values, features, belief = appealed(history)
    assert np.argmin(values) == 2
    assert belief.deviations(features[[0]] - features[[2]])[0] > 2
    assert pair is None


def test_an_unsafe_sample_is_neither_the_best_nor_its_rival():
    answers = [(0, -1), (1, -1), (1, -1)]
    pair, values, *_ = appealed(line(answers))
    assert (pair, np.argmin(values)) == ((3, 2), 3)
    assert appealed(line(answers, marks=(Mark.CHALLENGER_UNSAFE,)))[0] == (2, 0)
    again = Answer(-1, marks=(Mark.CHALLENGER_UNSAFE,))  # 2 is better than 1, and unsafe
    assert appealed(line(answers).told_further(again, 2, 1))[0] == (3, 0)


def test_a_bisection_takes_no_notice_of_answers_about_other_samples():
    history = line([(0, 1), (0, 1), (0, 1), (0, 1)])
    values = np.array([0.0, 1.0, 2.0, 3.0, 2.5])
    pair = to_place(history, values)
    assert pair == to_place(history.told_further(Answer(1), 3, 1), values) == (4, 2)


def further_pairs(flips, questions, seed=0):
    """(challenger, incumbent, latest) of each further question of a study with mistakes."""
    settings = GLISpSettings(questions_per_experiment=questions)
    agent, asked = GLISp(SQUARE, n_init=6, n_max=24, settings=settings, seed=seed), []
    while not agent.done:
        latest = len(agent.samples) - 1
        (query,) = drive(
            agent,
            by(lambda theta: float(np.sum((theta - 0.2) ** 2))),
            1,
            wrong=lambda query: query.challenger.index in flips and not query.further,
        )
        if query.further:
            asked.append((query.challenger.index, query.incumbent.index, latest))
    return asked


@pytest.mark.parametrize("questions", [2, 3])
def test_once_answers_are_doubted_others_than_the_latest_are_asked_too(questions):
    appeals = 0
    for seed in range(4):
        asked = further_pairs({7, 9, 12, 16}, questions, seed)
        appeals += sum(latest not in (a, b) for a, b, latest in asked)
        latest = [latest for *_, latest in asked]
        # After the last experiment former bests may meet the best, on top.
        assert max(latest.count(k) for k in latest if k < 23) <= questions - 1
    assert appeals >= 5


def test_somebody_who_never_errs_is_asked_about_the_latest_only():
    asked = further_pairs(set(), 3)
    assert asked
    assert all(latest == a for a, _, latest in asked)
