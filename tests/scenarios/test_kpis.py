"""KPIs of a scenario for an agent, what they say about a person, and how they are exported."""

import json
from dataclasses import replace

import numpy as np
import pytest

from prefcal_agents import GLISp, LatinHypercube
from prefcal_agents.models.kpi_importance import Importance
from prefcal_agents.models.learned_cost import LearnedCost, Term
from prefcal_env import End, Preference
from prefcal_env.errors import ScenarioError, StudyError
from prefcal_env.study import StudyFile, export_csv, export_json, import_json
from prefcal_scenarios import KPI, load, outcome, screened, simulate_many, simulator
from prefcal_scenarios.app.cli.cost_file import KPICost, with_cost
from prefcal_scenarios.app.cli.studies.changes import module
from prefcal_scenarios.app.report.kpi_importance import KpiImportance
from prefcal_scenarios.kpis import INTERRUPTED, seen, titles
from prefcal_scenarios.many.results import FailedRun
from support.interviews import answer_all, begin, clock, reopened
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
    assert {*screened(TOY, FINE)} == {*seen(TOY)} - {INTERRUPTED}
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
    assert set(simulator("servo")(middle)) == set(seen(servo)) - {INTERRUPTED}
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


@pytest.mark.parametrize("name", ["cstr", "overtake"])
def test_titles_read_like_words(name):
    scenario = load(name)
    assert all("_" not in title or "_{" in title or len(title.split()) > 1
               for title in titles(scenario).values())  # fmt: skip
    assert set(titles(scenario)) >= {kpi.name for kpi in scenario.kpis}


@pytest.fixture(scope="module")
def interview():
    interview = begin(TOY, n_max=20)
    answer_all(interview, lambda number: None)
    return interview


def test_every_answer_is_recorded_with_what_happened(interview):
    for closed in interview.now().state.history.comparisons:
        new, old = closed.answer.outcomes
        assert new == outcome(TOY, interview.experiment(closed.challenger))
        rival = closed.incumbent
        assert old == (None if rival is None else outcome(TOY, interview.experiment(rival)))


def test_an_export_with_outcomes_is_read_back_and_its_tables_are_written(interview, tmp_path):
    text = export_json(interview.study)
    assert "Infinity" not in text
    json.loads(text, parse_constant=pytest.fail)
    path = import_json(text, tmp_path / "again.prefcal")
    with StudyFile.open(path, clock=clock()) as file:
        assert file.state.history.comparisons == interview.now().state.history.comparisons
        export_csv(file, tmp_path / "tables")
    rows = (tmp_path / "tables" / "comparisons.csv").read_text().splitlines()
    assert len(rows) == len(interview.now().state.answers) + 1  # and the heading
    assert "t_f" in (tmp_path / "tables" / "experiments.csv").read_text()


def test_a_study_goes_on_with_its_outcomes_and_the_identical_next_question(tmp_path):
    first = begin(TOY, n_max=9, path=tmp_path / "a.prefcal")
    for _ in range(6):
        while first.work():
            pass
        question = first.now().question
        better = TOY.cost(question.challenger.experiment) < TOY.cost(question.incumbent.experiment)
        first.answer(question.id, question.choice(Preference(-1 if better else 1)))
    while first.work():
        pass
    there = first.now().question.challenger.experiment.theta
    index = first.index
    first.study.close()
    again = reopened(TOY, tmp_path / "a.prefcal")
    assert again.now().question.challenger.experiment.theta == pytest.approx(there, abs=0)
    assert again.index == index


def test_whatever_the_agent_the_answers_say_what_counts():
    interview = begin(TOY, n_max=20, agent=LatinHypercube)
    answer_all(interview, lambda number: None)
    index = interview.index
    assert index.explains
    assert index(outcome(TOY, FINE)) < index(outcome(TOY, UNSAFE))
    assert begin(TOY).index is None


def importance(right, *named, **agreement):
    """What is said of these KPIs, where a weighted sum predicts `right` of 44 answers."""
    index = LearnedCost({"t_f": Term(1.0, 0.0, 1.0)}, right, 44)
    return KpiImportance.of(index, Importance(agreement, named, 44), TOY)


def test_what_stands_out_is_named_by_title_and_bars_run_from_0_to_100_percent():
    found = importance(31, "t_f", "final", t_f=0.95, final=0.9, a=0.8, b=0.7, c=0.6, d=0.5, e=0.4)
    assert found.sentence() == (
        "You seem to care most about: settling time t_f and final level near its target."
    )
    assert found.trust.endswith("predicted 31 of 44 answers that it had not learned from.")
    assert [b.title for b in found.bars][:2] == [
        "settling time t_f",
        "final level near its target",
    ]
    assert len(found.bars) == 6
    assert (found.bars[0].share, found.bars[0].text) == (0.95, "95 %")
    assert "of the 44 answers" in found.caption


def test_of_equal_shares_nothing_is_named():
    equal = importance(40, t_f=0.75, final=0.74, a=0.74, b=0.73, c=0.73)
    assert equal.named == ()
    assert equal.sentence() == (
        "Nothing stands out yet: settling time t_f alone would have given 75 % of the answers, the "
        "most of all."
    )


def test_of_a_few_answers_nothing_is_said_and_no_bar_is_drawn():
    known = LearnedCost({"t_f": Term(1.0, 0.0, 1.0)}, 3, 7)
    found = KpiImportance.of(known, Importance({"t_f": 0.9}, (), 7), TOY)
    assert found.bars == ()
    assert found.caption == ""
    assert found.sentence() == "This takes 8 answers that prefer one side: so far there are 7."


def test_what_predicts_like_a_coin_is_said_to():
    found = importance(23, t_f=0.5)
    assert found.sentence().startswith("Nothing stands out yet: ")
    assert "23 of 44" in found.trust
    assert KpiImportance.of(None, None, TOY) is None


def test_the_exported_cost_is_the_index_of_the_outcome(interview, tmp_path):
    index = interview.index
    assert index is not None
    source = f"{toy_file()}:toy"
    file = tmp_path / "mine.py"
    file.write_text(module(index, source), encoding="utf-8")
    scenario = with_cost(toy_scenario("plain"), f"{file}:cost")
    for experiment in (FINE, UNSAFE):
        assert scenario.cost(experiment) == pytest.approx(index(outcome(TOY, experiment)))
    assert scenario.cost(FINE) < scenario.cost(UNSAFE)


def toy_file():
    from toy_study import TOY_FILE

    return TOY_FILE


COSTS = """
from math import inf, nan
three = 3
def infinite(experiment): return inf
def unknown(experiment): return nan
def words(experiment): return "good"
def yes(experiment): return True
def fine(experiment): return experiment.theta[0]
"""


@pytest.mark.parametrize("name", ["infinite", "unknown", "words", "yes"])
def test_a_cost_that_is_no_finite_number_is_refused(tmp_path, name):
    (tmp_path / "costs.py").write_text(COSTS)
    scenario = with_cost(TOY, f"{tmp_path}/costs.py:{name}")
    with pytest.raises(ScenarioError, match="must give a finite number"):
        scenario.cost(FINE)
    assert with_cost(TOY, f"{tmp_path}/costs.py:fine").cost(FINE) == 0.4


def test_a_kpi_can_be_the_cost_and_a_stopped_run_is_the_worst():
    name = next(kpi.name for kpi in TOY.kpis if kpi.goal is not None)
    scenario = with_cost(TOY, name)
    assert scenario.cost(FINE) == outcome(TOY, FINE)[name]
    assert scenario.cost(UNSAFE) == np.inf
    with pytest.raises(ScenarioError, match="Did you mean"):
        with_cost(TOY, name[:-1])


@pytest.mark.parametrize("end", [End.UNSAFE, End.FAILED])
@pytest.mark.parametrize("kpis", [(), TOY.kpis])
def test_an_interrupted_run_without_the_kpi_that_is_the_cost_is_the_worst(end, kpis):
    name = next(kpi.name for kpi in TOY.kpis if kpi.goal is not None)
    cost = with_cost(TOY, name).cost
    found = KPICost(name, replace(TOY, kpis=kpis))
    interrupted = replace(UNSAFE, end=end, kpis={})
    assert cost(interrupted) == found(interrupted) == np.inf
    with pytest.raises(ScenarioError, match="a KPI of the scenario"):
        found(replace(FINE, kpis={}))


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("no.py:cost", "no file"),
        ("costs.py", "path/to/own.py:NAME"),
        ("costs.py:", "path/to/own.py:NAME"),
        ("cost", "path/to/own.py:NAME"),
        ("costs.py:nothing", "nothing of that name"),
        ("costs.py:three", "got 3"),
    ],
)
def test_a_cost_that_is_not_there_is_refused(tmp_path, monkeypatch, source, message):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "costs.py").write_text(COSTS)
    with pytest.raises(ScenarioError, match=message):
        with_cost(TOY, source)


def test_glisp_sees_the_outcomes_in_an_interview(interview):
    agent = interview._flow.agent
    assert isinstance(agent, GLISp)
    assert agent.index == interview.index


def test_an_index_of_nothing_is_an_error_of_ours(tmp_path, monkeypatch):
    from prefcal_scenarios.app.cli.studies.changes import export_index

    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    with pytest.raises(StudyError, match="there is no study"):
        export_index("mine", None, None)
