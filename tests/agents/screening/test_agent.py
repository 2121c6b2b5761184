"""When an agent that simulates asks again."""

from collections import Counter

import numpy as np

from contracts.agents import MIXED
from prefcal_agents import Screening
from support.agents import quick


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
    study, wrong = agent(seed), None
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


def test_a_pair_is_asked_at_most_twice_whatever_the_answers():
    asked = 0
    for seed in range(3):
        study, rng = agent(seed, n_max=9), np.random.default_rng(seed)
        while not study.done:
            study.tell(study.ask(), int(rng.choice([-1, 0, 1])))
        pairs = [c for c in study.history.counting if c.incumbent is not None]
        times = Counter(frozenset({c.challenger, c.incumbent}) for c in pairs)
        assert max(times.values()) <= 2
        asked += len(study.history.follow_ups)
    assert asked >= 1
