from dataclasses import replace
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from prefcal_bench.people import TASTES, runs_of, taste, worth
from prefcal_bench.problems import Outcome, Person, judges, prefer, problem
from prefcal_env.errors import KnobError, SettingsError
from prefcal_env.preferences.answer import Preference
from prefcal_scenarios.runs import INTERRUPTED

OWN = Path(__file__).parents[1] / "bench_support" / "loop.py"
module = import_module("prefcal_bench.problems.problem")


@pytest.fixture
def tiny(small_samples, monkeypatch, tmp_path):
    """A closed loop that takes microseconds, nothing of which has been computed."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setenv("WIN_PD_OVERRIDE_LOCAL_APPDATA", str(tmp_path / "cache"))
    return problem(f"{OWN}:SCENARIO")


@pytest.mark.parametrize(
    ("name", "with_value"),
    [
        ("camel", {"perfect"}),
        ("cstr-guidelines", set()),
        ("cstr", {"perfect", "weights", "limits", "narrow", "hidden"}),
        ("overtake", {"weights", "limits", "narrow", "hidden"}),
        ("servo", {"weights", "limits", "narrow", "hidden"}),
    ],
)
def test_agents_can_be_told_a_value_where_answers_follow_one(name, with_value):
    where = problem(name)
    assert {who for who in where.answering if where.has_value(who)} == with_value


def test_a_problem_with_calibrators_needs_a_referee():
    camel = problem("camel")
    with pytest.raises(SettingsError, match="'camel' has calibrators, and so needs a referee"):
        replace(camel, referee=None)


def test_people_have_a_gap_where_there_is_a_cost_and_a_worth_where_there_is_a_taste(tiny):
    camel, person = problem("camel"), problem("camel").person("noisy10", 3)
    assert person.worth is None
    low = camel.outcome(np.array([0.0898, -0.7126]))
    assert person.gap(low) == camel.gap(low) == pytest.approx(0.0, abs=1e-6)
    assert person.cost(low) == low.cost
    blind = problem("overtake").person("lexicographic", 0)
    assert blind.gap is None
    assert blind.worth is None
    by_taste = tiny.person("weights", 0)
    assert by_taste.gap is None
    assert by_taste.worth(tiny.outcome(np.array([0.5, 0.5, 0.5]))) >= 1.0


@pytest.mark.parametrize("name", TASTES)
def test_whoever_has_a_taste_answers_on_a_closed_loop(tiny, name):
    one, other = (tiny.outcome(tiny.space.decode(np.full(3, z))) for z in (0.2, 0.6))
    first, again = (tiny.person(name, 5) for _ in "ab")
    verdict = prefer(first.judge, one, other)
    assert isinstance(verdict, Preference)
    assert prefer(again.judge, one, other) is verdict
    # As somebody else would make the same person from the same runs.
    usual, pool = (module.sample(tiny.scenario, which) for which in ("usual", "pool"))
    same = taste(name, tiny.scenario.kpis, usual, 5)
    assert int(same.calibrator().prefer(one.experiment, other.experiment)) == verdict
    assert first.worth(one) == module.person_of(same, pool).worth(one)


@pytest.mark.parametrize("name", ["rising", "rising-noisy20"])
def test_every_study_begins_with_the_standards_of_the_start(tiny, name):
    one, other = tiny.person(name, 5).judge, tiny.person(name, 5).judge
    assert one is not other
    assert getattr(one, "calibrator", one).rule is not getattr(other, "calibrator", other).rule


def test_samples_are_prepared_once_and_read_once(tiny, monkeypatch):
    assert not tiny.is_prepared
    tiny.prepare()
    assert tiny.is_prepared
    read = []
    monkeypatch.setattr(module, "sample", lambda *words: read.append(words))
    tiny.person("weights", 1)
    assert not read
    monkeypatch.setattr(module, "_READ", {})
    tiny.prepare()
    assert [name for _, name in read] == ["usual", "pool"]


def test_without_a_scenario_nothing_is_to_be_prepared():
    assert problem("camel").is_prepared
    problem("camel").prepare()
    assert problem("camel").kpi_names == ()


@pytest.mark.parametrize(("name", "who"), [("camel", "weights"), ("servo", "perfect")])
def test_somebody_unknown_says_who_answers(name, who):
    expected = f"calibrator of {name} must be one of .*, got '{who}'"
    with pytest.raises(SettingsError, match=expected):
        problem(name).person(who, 0)


def test_theta_outside_the_box_of_a_loop_is_refused(tiny):
    with pytest.raises(KnobError, match="lead"):
        tiny.outcome(np.array([0.5, 1.5, 0.5]))


def test_a_loop_has_no_gap(tiny):
    with pytest.raises(SettingsError, match="no cost"):
        tiny.gap(tiny.outcome(np.array([0.5, 0.5, 0.5])))


def test_an_abstention_is_refused_in_the_benchmark():
    class Abstains:
        def prefer(self, challenger, incumbent):
            return None

    outcome = Outcome(np.zeros(2), 1.0)
    with pytest.raises(SettingsError, match="must decide"):
        prefer(Abstains(), outcome, outcome)


def test_noisy_judges_flip_the_referee():
    referee = problem("camel").referee
    made = judges(referee, "perfect")
    assert list(made) == ["perfect", "noisy10", "noisy20"]
    assert made["perfect"](1) is made["perfect"](2) is referee
    rng = np.random.default_rng(0)
    pairs = [[Outcome(rng.random(2), float(rng.random())) for _ in "ab"] for _ in range(400)]
    sure = [prefer(referee, *pair) for pair in pairs]
    for name, share in (("noisy10", 0.1), ("noisy20", 0.2)):
        said = [prefer(made[name](3), *pair) for pair in pairs]
        wrong = np.mean([a != b for a, b in zip(said, sure, strict=True)])
        assert wrong == pytest.approx(share, abs=0.05)


# Who answers.


def outcomes(where, count=12):
    rng = np.random.default_rng(1)
    return [where.outcome(where.space.decode(rng.random(3))) for _ in range(count)]


def test_an_outcome_of_a_function_is_judged_itself_and_another_by_its_experiment(tiny):
    function = Outcome(np.zeros(2), 1.0)
    assert function.judged is function
    (loop,) = outcomes(tiny, 1)
    assert loop.judged is loop.experiment


def test_a_person_of_a_function_tells_cost_and_kpis_as_they_are():
    person = Person(judge=problem("camel").referee)
    outcome = Outcome(np.zeros(2), 1.5)
    assert person.cost(outcome) == 1.5
    assert person.told(outcome) is None
    assert person.gap is person.worth is None


@pytest.mark.parametrize("name", ["weights", "limits", "narrow", "hidden", "rising"])
def test_the_cost_that_is_told_follows_the_referee(tiny, name):
    where, them = tiny, outcomes(tiny)
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


@pytest.mark.parametrize("name", ["weights-noisy20", "priorities", "rising-noisy10"])
def test_worth_is_the_referee_s_whatever_is_answered(tiny, name):
    where, them = tiny, outcomes(tiny)
    person, pool = where.person(name, 2), where._runs("pool")
    rule = taste(name, where.scenario.kpis, where._runs("usual"), 2).rule
    for each in them:
        one = runs_of(where.scenario.kpis, [each.experiment])
        assert person.worth(each) == worth(rule, pool, one)
        assert 1.0 <= person.worth(each) <= len(pool) + 1


def test_agents_are_told_all_kpis_and_of_a_hidden_taste_only_the_others(tiny):
    where, (outcome, *_) = tiny, outcomes(tiny, 1)
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


def test_that_a_run_was_interrupted_is_told_even_if_all_is_hidden(tiny):
    where = tiny
    stopped = where.outcome(np.array([0.95, 0.5, 0.5]))
    assert where.person("hidden", 0).told(stopped)[INTERRUPTED] == 1.0
