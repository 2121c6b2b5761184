"""Runs cut short in a study: nobody is asked, and undo, resuming, report and export know them."""

import csv
import io
import shutil
from dataclasses import replace
from functools import partial

import pytest

from prefcal_agents import GLIS, GLISp, GLISpSettings
from prefcal_agents.history.lessons import Marks
from prefcal_env import End
from prefcal_env.errors import SettingsError, StaleError
from prefcal_env.preferences.answer import Answer, Mark, Preference
from prefcal_env.study import export_csv
from prefcal_scenarios import load
from prefcal_scenarios.app.cli.options import Options
from prefcal_scenarios.app.cli.report import record_of
from prefcal_scenarios.app.report import Record
from prefcal_scenarios.app.report.comparisons import comparisons_as_csv
from prefcal_scenarios.app.report.html import page
from prefcal_scenarios.app.session import Phase, unattended
from prefcal_scenarios.app.web.view import asked_view, history_view, now_view
from prefcal_scenarios.tastes import calibrators_of
from support.interviews import begin, reopened
from toy_study import toy_scenario

TANK = load("tank")
EXPERIMENTS = 24


def person():
    return calibrators_of(TANK)["weights"](1)


def studied(path=None, experiments=EXPERIMENTS):
    interview = begin(TANK, n_max=experiments, seed=1, path=path, cut_short=True)
    for _ in unattended(interview, person()):
        pass
    return interview


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    return tmp_path_factory.mktemp("cut") / "cut.prefcal"


@pytest.fixture(scope="module")
def study(path):
    return studied(path)


def cut_ones(interview):
    return sorted(interview.now().state.history.cut_short())


def until_a_cut(**more):
    """An interview in which the last answer was made by a cut."""
    interview = begin(TANK, n_max=EXPERIMENTS, seed=1, cut_short=True, **more)
    judge = person()
    while not cut_ones(interview):
        now = interview.now()
        if now.phase is Phase.QUESTION:
            new, old = now.question.challenger.experiment, now.question.incumbent.experiment
            interview.give(now.question.id, Answer.of(judge.prefer(new, old)))
        else:
            assert interview.work()
    return interview


def test_a_run_that_cannot_win_is_recorded_as_cut_short_and_loses_without_a_question(study):
    history, cut = study.now().state.history, cut_ones(study)
    assert cut
    for index in cut:
        closed, made = history.comparisons[index], study.experiment(index)
        assert made.end is End.CUT_SHORT
        assert made.duration < study.experiment(0).duration
        assert closed.question is None
        assert closed.answer.preference is Preference.INCUMBENT
        assert closed.answer.automatic == (Mark.CHALLENGER_CUT_SHORT,)
        assert closed.incumbent is not None
    assert not history.unsafe()
    assert study.now().incumbent not in cut
    ends = [study.end(i) for i in range(EXPERIMENTS)]
    assert [i for i, end in enumerate(ends) if end is End.CUT_SHORT] == cut


def test_the_file_resumes_to_the_same_agent_and_verifies(study, path, tmp_path):
    before = study._flow.agent.state
    # The study is still open for the other tests, which locks its file.
    again = reopened(TANK, shutil.copy(path, tmp_path / "copied.prefcal"))
    assert again._flow.agent.state == before
    assert cut_ones(again) == cut_ones(study)
    assert GLISp.restore(TANK.space, before).state == before


def test_the_same_seed_gives_the_same_study(study):
    twin = studied()
    assert twin._flow.agent.state == study._flow.agent.state


def test_after_an_undo_the_person_answers_about_what_was_recorded():
    interview = until_a_cut()
    (index,) = cut_ones(interview)
    now = interview.undo(interview.now().version)
    assert now.phase is Phase.QUESTION
    assert now.question.challenger.index == index
    assert now.question.challenger.experiment.end is End.CUT_SHORT
    interview.give(now.question.id, Answer(Preference.CHALLENGER))
    closed = interview.now().state.history.comparisons[index]
    assert closed.question == now.question.id
    assert Mark.CHALLENGER_CUT_SHORT in closed.answer.automatic  # its KPIs are bounds all the same
    assert interview._flow.agent.history.cut_short() == {index}


def test_a_cut_can_be_retracted():
    interview = until_a_cut()
    (index,) = cut_ones(interview)
    now = interview.retract(index)
    assert now.state.history.comparisons[index].retracted
    assert interview._flow.agent.history.bare() == now.state.history.bare()
    with pytest.raises(StaleError, match="retracted already"):
        interview.retract(index)


def test_page_report_and_export_say_when_and_why(study, tmp_path):
    index = cut_ones(study)[0]
    after = f"cut short after {study.experiment(index).duration:.4g} s: could no longer win"
    row = next(r for r in history_view(study)["answers"] if r["challenger"] == index + 1)
    assert row["marks"] == ["first: run cut short, it could no longer win"]
    assert row["answer"] == index
    shown = asked_view(study, index)["question"]
    assert [shown[side]["ended"] == after for side in ("left", "right")].count(True) == 1
    held = study.now().state.history.incumbents()
    record = Record(TANK, "tank", study.comparisons(), held)
    assert "first: run cut short" in page(record, [])
    table = list(csv.DictReader(io.StringIO(comparisons_as_csv(record))))
    assert after in [row["challenger ended"] for row in table if row["automatic marks"]]
    with (export_csv(study.study, tmp_path) / "comparisons.csv").open() as file:
        assert "challenger cut short" in file.read()


def test_a_cut_teaches_theta_that_it_is_worse_and_marks_nothing(study):
    history = study._flow.agent.history
    assert not Marks.of(history).unsafe.any()
    taught = {c.challenger for c in history.lessons()}
    assert set(cut_ones(study)) <= taught


def test_without_the_option_no_simulated_run_is_cut():
    interview = begin(TANK, n_max=16, seed=1)
    for _ in unattended(interview, person()):
        pass
    assert not cut_ones(interview)


def test_what_cannot_be_cut_is_refused():
    with pytest.raises(SettingsError, match="does not say which KPIs can only get worse"):
        begin(toy_scenario(), cut_short=True)
    blind = partial(GLISp, settings=GLISpSettings(kpis=False))
    with pytest.raises(SettingsError, match="only the agent glisp, told the KPIs"):
        begin(TANK, agent=blind, cut_short=True)
    with pytest.raises(SettingsError, match="runs are cut short one at a time"):
        begin(TANK, at_once=2, cut_short=True)


def test_a_cut_is_no_comparison_of_the_person_but_stays_in_the_tables(study):
    cut, history = cut_ones(study), study.now().state.history
    asked = [c for c in history.counting if c.question is not None]
    record = record_of(study, Options("tank", calibrator="weights"), {})
    assert len(asked) + len(cut) == EXPERIMENTS - 1
    assert study.counts.comparisons == record.questions == len(asked)
    assert sum(study.counts.verdicts.values()) == sum(record.verdict_counts().values())
    assert sum(study.counts.verdicts.values()) == len(asked)
    assert now_view(study)["progress"]["given"] == len(asked)
    rows = list(csv.DictReader(io.StringIO(comparisons_as_csv(record))))
    assert len(rows) == EXPERIMENTS - 1
    assert sum("challenger cut short" in row["automatic marks"] for row in rows) == len(cut)


def ends_early():
    """The toy, whose plant says by itself that every run but the first could no longer win."""
    toy, ran = toy_scenario(), []

    def run(theta, seed=0):
        ran.append(theta)
        made = toy.run(theta, seed)
        return made if len(ran) == 1 else replace(made, end=End.CUT_SHORT)

    return replace(toy, run=run)


@pytest.mark.parametrize("at_once", [1, 2])
def test_a_plant_that_ends_runs_early_by_itself_does_not_answer_for_the_person(at_once):
    scenario = ends_early()
    interview = begin(scenario, n_max=5, at_once=at_once)
    for _ in unattended(interview, scenario.calibrators["synthetic"](0)):
        pass
    history = interview.now().state.history
    assert interview.now().phase is Phase.OVER
    assert history.cut_short()
    assert all(c.question is not None for c in history.comparisons[1:])


def test_a_run_that_a_plant_ended_early_has_no_score():
    interview = begin(ends_early(), n_max=5, agent=GLIS)
    for _ in unattended(interview, None):
        pass
    scores = [c.answer.value for c in interview.now().state.history.comparisons]
    assert interview.now().phase is Phase.OVER
    assert scores[0] is not None
    assert scores[1:] == [None] * 4


@pytest.mark.parametrize("error", [ZeroDivisionError("by zero"), SystemExit(3)])
def test_a_simulation_stays_whole_with_a_note_if_so_far_fails(error):
    def fails(experiment):
        raise error

    interview = begin(replace(TANK, so_far=fails), n_max=3, seed=1, cut_short=True)
    for _ in unattended(interview, person()):
        pass
    state = interview.now().state
    assert interview.now().phase is Phase.OVER
    assert not state.history.cut_short()
    assert {interview.end(i) for i in range(3)}.isdisjoint({End.CUT_SHORT, End.FAILED})
    words = [text for _, text in state.notes]
    assert len(words) == 3
    assert words[1].startswith("experiment 2 was not cut short: cannot tell whether it could still")
    assert type(error).__name__ in words[1]
