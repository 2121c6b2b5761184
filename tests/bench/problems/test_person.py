from pathlib import Path

import numpy as np
import pytest

from prefcal_bench.people import runs_of, taste, worth
from prefcal_bench.problems import Outcome, Person, prefer, problem
from prefcal_scenarios.kpis import INTERRUPTED

OWN = Path(__file__).parents[2] / "support" / "bench_loop.py"
pytestmark = pytest.mark.usefixtures("small_samples")


def tiny():
    return problem(f"{OWN}:SCENARIO")


def outcomes(count=12):
    where, rng = tiny(), np.random.default_rng(1)
    return [where.outcome(where.space.decode(rng.random(3))) for _ in range(count)]


def test_an_outcome_of_a_function_is_judged_itself_and_another_by_its_experiment():
    function = Outcome(np.zeros(2), 1.0)
    assert function.judged is function
    (loop,) = outcomes(1)
    assert loop.judged is loop.experiment


def test_a_person_of_a_function_tells_cost_and_kpis_as_they_are():
    person = Person(judge=problem("camel").referee)
    outcome = Outcome(np.zeros(2), 1.5)
    assert person.cost(outcome) == 1.5
    assert person.told(outcome) is None
    assert person.gap is person.worth is None


@pytest.mark.parametrize("name", ["weights", "limits", "narrow", "hidden", "rising"])
def test_the_cost_that_is_told_follows_the_referee(name):
    where, them = tiny(), outcomes()
    person = where.person(name, 2)
    usual = where._runs("usual")
    rule = taste(name, where.scenario.kpis, usual, 2).rule
    costs = [person.cost(each) for each in them]
    runs = runs_of(where.scenario.kpis, [each.experiment for each in them])
    assert costs == pytest.approx(rule.cost(runs))
    assert all(isinstance(cost, float) for cost in costs)
    if name != "rising":
        for a, b in ((0, 1), (2, 3), (4, 5)):
            assert prefer(person.judge, them[a], them[b]) == np.sign(costs[a] - costs[b])


def test_priorities_have_no_cost_to_tell():
    assert tiny().person("priorities", 0).cost(outcomes(1)[0]) is None


@pytest.mark.parametrize("name", ["weights-noisy20", "priorities", "rising-noisy10"])
def test_worth_is_the_referee_s_whatever_is_answered(name):
    where, them = tiny(), outcomes()
    person, pool = where.person(name, 2), where._runs("pool")
    rule = taste(name, where.scenario.kpis, where._runs("usual"), 2).rule
    for each in them:
        one = runs_of(where.scenario.kpis, [each.experiment])
        assert person.worth(each) == worth(rule, pool, one)
        assert 1.0 <= person.worth(each) <= len(pool) + 1


def test_agents_are_told_all_kpis_and_of_a_hidden_taste_only_the_others():
    where, (outcome, *_) = tiny(), outcomes(1)
    assert where.person("weights", 0).told(outcome) == outcome.kpis
    assert set(outcome.kpis) == {"error", "effort", "margin", INTERRUPTED}
    seen = set()
    for seed in range(8):
        rule = taste("hidden", where.scenario.kpis, where._runs("usual"), seed).rule
        withheld = {term.name for term in rule.terms}
        for end in ("", "-noisy10", "-noisy20"):
            told = where.person(f"hidden{end}", seed).told(outcome)
            assert set(told) == {"error", "effort", "margin", INTERRUPTED} - withheld
            assert all(told[name] == outcome.kpis[name] for name in told)
        seen |= withheld
    assert seen == {"error", "effort", "margin"}


def test_that_a_run_was_interrupted_is_told_even_if_all_is_hidden():
    where = tiny()
    stopped = where.outcome(np.array([0.95, 0.5, 0.5]))
    assert where.person("hidden", 0).told(stopped)[INTERRUPTED] == 1.0
