"""Whom an agent that simulates takes for the best, and what it never asks."""

from dataclasses import replace

import numpy as np
import pytest

from contracts.agents import MIXED
from prefcal_agents import Screening
from prefcal_agents.agent import AgentState
from prefcal_env.errors import SettingsError
from prefcal_env.preferences.answer import Reading
from prefcal_env.preferences.history import Lead
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


def test_a_sure_person_is_asked_once_for_each_experiment_and_their_winner_is_the_best():
    for seed in range(5):
        study = agent(seed)
        while not study.done:
            study.tell(study.ask(), sure(study.ask()))
        assert study.history.follow_ups == ()
        assert study.history.leads == ()


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


def test_a_mistake_of_a_sure_person_costs_the_best_nothing_and_no_question():
    led, mistakes = 0, 0
    for seed in range(5):
        study, wrong = after_a_mistake(seed)
        if wrong is None:  # the best one came too early to be called worse
            continue
        mistakes += 1
        costs = [wanted(theta) for theta in study.samples]
        assert study.history.follow_ups == ()
        led += bool(study.history.leads)
        assert costs[study.best_index] <= costs[wrong[0]]
    assert mistakes >= 3
    assert led >= 1


def test_a_study_goes_on_from_its_record_with_what_it_holds_for_the_best():
    study, _ = next(found for seed in range(9) if (found := after_a_mistake(seed))[0].history.leads)
    again = Screening.restore(MIXED, AgentState.from_dict(study.state.to_dict()))
    assert again.history == study.history
    assert again.history.incumbent == study.best_index
    assert study.copy().best_index == study.best_index


def test_a_state_whose_best_was_never_compared_is_refused():
    study = agent(0)
    study.tell(study.ask(), None)
    state = study.state
    wrong = replace(state, history=replace(state.history, leads=(Lead(3, 1),)))
    with pytest.raises(SettingsError, match="the best one of a state cannot be"):
        Screening.restore(MIXED, wrong)


def pairs_of(study, choices, seed):
    """The pairs of a study of somebody who answers at random, in order."""
    rng, pairs = np.random.default_rng(seed), []
    while not study.done:
        query, answer = study.ask(), int(rng.choice(choices))
        if query.incumbent is not None:
            pairs.append(frozenset({query.challenger.index, query.incumbent.index}))
        study.tell(query, answer)
    return pairs


@pytest.mark.parametrize("choices", [(-1, 0, 1), (-1, 1), (0, 0, 1), (0,)])
def test_no_pair_comes_back_whatever_the_answers(choices):
    for seed in range(3):
        study = agent(seed, n_max=14)
        pairs = pairs_of(study, choices, seed)
        assert len(set(pairs)) == len(pairs) == 13


def test_the_first_two_meet_the_objectives_and_differ_clearly():
    def simulate(theta):
        x, y = theta
        return {"time": np.inf if x < 0.8 else 1.0 + y, "error": y, "calm": 0.5 + x}

    simulate.reading = Reading({"time": 0.01, "error": 0.01, "calm": 0.01}, {"error": 0.3, "time": 1.4})
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
