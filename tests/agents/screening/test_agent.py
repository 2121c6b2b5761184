"""When an agent that simulates asks again."""

from collections import Counter

import numpy as np
import pytest

from contracts.agents import MIXED
from prefcal_agents import Screening
from prefcal_env.preferences.reading import Reading
from support.agents import quick
from support.simulated import SQUARE


def wanted(theta):
    """The cost of a person who looks at the KPI "first" before all others."""
    kpis = quick(theta)
    return kpis["first"] + 0.05 * kpis["others"]


def sure(query):
    if query.incumbent is None:
        return None
    return int(np.sign(wanted(query.challenger.theta) - wanted(query.incumbent.theta)))


def agent(seed, n_max=10):
    return Screening(MIXED, simulate=quick, n_simulated=50, n_max=n_max, seed=seed)


def test_a_sure_person_is_hardly_ever_asked_again():
    asked = 0
    for seed in range(3):
        study = agent(seed)
        while not study.done:
            study.tell(study.ask(), sure(study.ask()))
        asked += len(study.history.follow_ups)
    assert asked <= 1  # in 27 answers


def after_a_mistake(seed):
    """A study of a sure person who once says that a better experiment is worse, and its pair."""
    study, wrong = agent(seed, n_max=14), None
    while not study.done:
        query = study.ask()
        answer = sure(query)
        if wrong is None and study.history.answered > 2 and answer == -1:
            wrong, answer = (query.challenger.index, query.incumbent.index), 1
        study.tell(query, answer)
    return study, wrong


def test_a_mistake_of_a_sure_person_is_asked_again_or_overtaken():
    asked, mistakes = 0, 0
    for seed in range(5):
        study, wrong = after_a_mistake(seed)
        if wrong is None:  # the best one came too early to be called worse
            continue
        mistakes += 1
        costs = [wanted(theta) for theta in study.samples]
        again = [c for c in study.history.follow_ups if (c.challenger, c.incumbent) == wrong]
        assert len(again) <= 1
        asked += len(again)
        assert costs[study.best_index] <= costs[wrong[0]]
    assert mistakes >= 3
    assert asked >= 1


def pairs_of(study, choices, seed):
    """The pairs of a study of somebody who answers at random, in order, and the answers."""
    rng, pairs, answers = np.random.default_rng(seed), [], []
    while not study.done:
        query, answer = study.ask(), int(rng.choice(choices))
        if query.incumbent is not None:
            pairs.append(frozenset({query.challenger.index, query.incumbent.index}))
            answers.append(answer)
        study.tell(query, answer)
    return pairs, answers


@pytest.mark.parametrize("choices", [(-1, 0, 1), (-1, 1), (0, 0, 1), (0,)])
def test_pairs_come_back_rarely_late_and_never_after_a_tie_whatever_the_answers(choices):
    for seed in range(3):
        study = agent(seed, n_max=14)
        pairs, answers = pairs_of(study, choices, seed)
        assert max(Counter(pairs).values()) <= 2
        settled = [p for k, p in enumerate(pairs) if answers[k] == 0 and p in pairs[k + 1 :]]
        assert not settled
        for place, pair in enumerate(pairs):
            assert pair not in pairs[max(place - 5, 0) : place]
        assert len(study.history.follow_ups) <= 3
        assert 13 <= len(pairs) <= 16


def test_the_first_two_meet_the_objectives_and_differ_clearly():
    def simulate(theta):
        x, y = theta
        return {"time": np.inf if x < 0.8 else 1.0 + y, "error": y, "calm": 0.5 + x}

    simulate.reading = Reading(
        {"time": 0.01, "error": 0.01, "calm": 0.01}, {"error": 0.3, "time": 1.4}
    )
    for seed in range(5):
        study = Screening(SQUARE, simulate=simulate, n_simulated=800, n_max=3, seed=seed)
        study.tell(study.ask(), None)
        query = study.ask()
        first, second = (simulate(s.theta) for s in (query.incumbent, query.challenger))
        assert all(kpis["error"] <= 0.3 and kpis["time"] <= 1.4 for kpis in (first, second))
        assert any(abs(first[n] - second[n]) >= 0.09 * abs(first[n]) for n in first)


def test_differences_that_cannot_be_read_change_nothing():
    def simulate(theta):
        return {"a": 0.1 + theta[0], "b": 1.1 - theta[0], "c": 1e-7 * (1 + theta[1])}

    simulate.reading = Reading({"a": 0.001, "b": 0.001, "c": 0.001})
    study = Screening(SQUARE, simulate=simulate, n_simulated=60, n_max=4, seed=0)
    study.tell(study.ask(), None)
    assert np.all(study.bank.kpis[:, study.bank.names.index("c")] == 0.0)
    assert "c" not in (*study.reason.better_in, *study.reason.worse_in)
