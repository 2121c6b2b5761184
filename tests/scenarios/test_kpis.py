"""KPIs of a scenario for an agent, what they say about a person, and how they are exported."""

from dataclasses import replace

import numpy as np
import pytest

from prefcal_agents.baselines import LatinHypercube
from prefcal_agents.learned_cost import CostTerm, LearnedCost
from prefcal_app.session.study import trust_text
from prefcal_env import End
from prefcal_env.errors import ScenarioError
from prefcal_scenarios import KPI, load, outcome, simulate_many, simulator
from prefcal_scenarios.runs import INTERRUPTED, FailedRun, screened
from support.interviews import answer_all, begin
from toy_study import toy_scenario

TOY = toy_scenario()
FINE, UNSAFE = TOY.run(np.array([0.4, 20, 1.0])), TOY.run(np.array([0.4, 20, 80.0]))


def test_agents_are_told_the_scenario_s_kpis_with_a_direction_lower_is_better():
    known = outcome(TOY, FINE)
    assert known["t_f"] == FINE.kpis["t_f"]
    assert known["final"] == pytest.approx(abs(FINE.kpis["final"] - 2.0))  # from the middle
    assert "total move of valve" not in known  # a generic one
    assert outcome(replace(TOY, kpis=()), FINE)["total move of valve"] > 0
    assert known[INTERRUPTED] == 0.0
    assert "largest" not in known  # no objective: nobody knows which way is better


def test_of_a_run_that_was_stopped_everything_is_as_bad_as_can_be():
    known = outcome(TOY, UNSAFE)
    assert UNSAFE.end is End.UNSAFE
    assert set(known) == set(outcome(TOY, FINE))
    assert all(v == np.inf for name, v in known.items() if name != INTERRUPTED)
    assert known[INTERRUPTED] == 1.0


def test_the_kpis_of_a_run_that_was_cut_short_are_unknown():
    assert dict(outcome(TOY, replace(FINE, end=End.CUT_SHORT))) == {}


def test_screened_are_the_kpis_with_a_direction_if_any_has_one():
    assert {*screened(TOY, FINE)} == {kpi.name for kpi in TOY.kpis if kpi.goal is not None}
    assert all(value == outcome(TOY, FINE)[name] for name, value in screened(TOY, FINE).items())
    assert dict(screened(TOY, UNSAFE)) == dict.fromkeys(screened(TOY, FINE), np.inf)
    nothing_measured = replace(UNSAFE, kpis={})
    assert screened(TOY, nothing_measured) == screened(TOY, UNSAFE)


def test_screened_are_generic_kpis_only_if_none_has_a_direction():
    bare = replace(TOY, kpis=())
    assert {**screened(bare, FINE), INTERRUPTED: 0.0} == dict(outcome(bare, FINE))
    assert len(screened(bare, FINE)) > 3
    assert dict(screened(bare, UNSAFE)) == dict.fromkeys(screened(bare, FINE), np.inf)
    [short] = simulate_many(bare, [[0.4, 20, 1.0]], jobs=1)
    with pytest.raises(ScenarioError, match="trajectories=True"):
        screened(bare, short)


def test_many_simulations_are_screened_as_single_ones_and_a_failed_one_has_no_kpis():
    thetas = np.array([[0.4, 20, 1.0], [0.4, 20, 80.0]])
    simulate = simulator(TOY)
    results = simulate_many(TOY, thetas, jobs=1)
    assert [screened(TOY, r) for r in results] == [simulate(theta) for theta in thetas]
    assert np.isinf(list(simulate(thetas[1]).values())).all()
    assert len(screened(TOY, FailedRun(thetas[0], "died", "its process ended"))) == 0


def test_a_simulator_is_made_of_a_name_and_refuses_a_run_that_is_no_experiment():
    servo = load("servo")
    middle = servo.space.decode(np.full(len(servo.space), 0.5))
    assert set(simulator("servo")(middle)) == {k.name for k in servo.kpis if k.goal is not None}
    broken = replace(TOY, run=lambda theta, seed=0: None)
    with pytest.raises(ScenarioError, match="Experiment"):
        simulator(broken)(np.array([0.4, 20, 1.0]))


@pytest.mark.parametrize(
    ("kpi", "value", "badness"),
    [
        (KPI("k", "k", at_most=3.0), 5.0, 5.0),
        (KPI("k", "k", at_least=3.0), 5.0, -5.0),
        (KPI("k", "k", at_least=3.0, at_most=5.0), 5.0, 1.0),
        (KPI("k", "k", better="higher", at_most=9.0), 5.0, -5.0),
        (KPI("k", "k", better="lower"), np.inf, np.inf),
        (KPI("k", "k", at_least=3.0), np.inf, None),  # nothing came near: no distance to speak of
        (KPI("k", "k", at_least=3.0), -np.inf, np.inf),
    ],
)
def test_badness_is_lower_for_the_better(kpi, value, badness):
    found = kpi.badness(value)
    assert np.isnan(found) if badness is None else found == badness


def test_a_kpi_is_better_lower_or_higher_or_nobody_knows():
    assert KPI("k", "k").goal is None
    with pytest.raises(ScenarioError, match="better"):
        KPI("k", "k", better="smaller")


@pytest.fixture(scope="module")
def interview():
    interview = begin(TOY, n_max=20)
    answer_all(interview, lambda number: None)
    return interview


def test_every_answer_is_recorded_with_what_happened(interview):
    for closed in interview.now().state.history.comparisons:
        new, old = closed.answer.outcomes
        assert new == outcome(TOY, interview.past.experiment(closed.challenger))
        rival = closed.incumbent
        assert old == (None if rival is None else outcome(TOY, interview.past.experiment(rival)))


def test_whatever_the_agent_the_answers_say_what_counts():
    interview = begin(TOY, n_max=20, agent=LatinHypercube)
    answer_all(interview, lambda number: None)
    index = interview.known.index
    assert index.explains
    assert index(outcome(TOY, FINE)) < index(outcome(TOY, UNSAFE))
    assert begin(TOY).known.index is None


@pytest.mark.parametrize(("right", "doubt"), [(31, ""), (23, ": not clearly better than chance")])
def test_how_far_a_sum_of_kpis_can_be_trusted_is_said(right, doubt):
    index = LearnedCost({"t_f": CostTerm(1.0, 0.0, 1.0)}, right, 44)
    assert trust_text(index) == (
        f"A weighted sum of the KPIs predicted {right} of 44 answers that it had not learned from{doubt}."
    )
