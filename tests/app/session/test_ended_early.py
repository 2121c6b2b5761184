"""Runs that a plant or a person ended early: who answers, and what page, report and export say."""

import csv
import io
from dataclasses import replace

import pytest

from prefcal_agents import GLIS
from prefcal_app.report import StudyRecord
from prefcal_app.report.record import comparisons_as_csv
from prefcal_app.report.write import page
from prefcal_app.session import Phase, unattended
from prefcal_app.view import asked_view, history_view
from prefcal_env import End
from prefcal_env.study import export_csv
from support.interviews import begin
from toy_study import toy_scenario


def ends_early():
    """The toy, whose plant says by itself that every run but the first could no longer win."""
    toy, ran = toy_scenario(), []

    def run(theta, seed=0):
        ran.append(theta)
        made = toy.run(theta, seed)
        return made if len(ran) == 1 else replace(made, end=End.CUT_SHORT)

    return replace(toy, run=run)


def studied(**more):
    scenario = ends_early()
    interview = begin(scenario, n_max=5, **more)
    for _ in unattended(interview, scenario.calibrators["synthetic"](0)):
        pass
    return interview


@pytest.mark.parametrize("at_once", [1, 2])
def test_a_plant_that_ends_runs_early_by_itself_does_not_answer_for_the_person(at_once):
    interview = studied(at_once=at_once)
    history = interview.now().state.history
    assert interview.now().phase is Phase.OVER
    assert history.cut_short
    assert all(c.question is not None for c in history.comparisons[1:])


def test_a_run_that_a_plant_ended_early_has_no_score():
    interview = begin(ends_early(), n_max=5, agent=GLIS)
    for _ in unattended(interview, None):
        pass
    scores = [c.answer.value for c in interview.now().state.history.comparisons]
    assert interview.now().phase is Phase.OVER
    assert scores[0] is not None
    assert scores[1:] == [None] * 4


def test_page_report_and_export_say_when_and_why(tmp_path):
    study = studied()
    index = min(study.now().state.history.cut_short)
    after = f"cut short after {study.past.experiment(index).duration:.4g} h: could no longer win"
    row = next(r for r in history_view(study)["answers"] if r["challenger"] == index + 1)
    assert "first: run cut short, it could no longer win" in row["marks"]
    shown = asked_view(study, index)["question"]
    assert after in [shown[side]["ended"] for side in ("left", "right")]
    held = study.now().state.history.incumbents()
    record = StudyRecord(study.scenario, "toy", study.past.comparisons(), held)
    assert "first: run cut short" in page(record, [])
    table = list(csv.DictReader(io.StringIO(comparisons_as_csv(record))))
    assert after in [row["challenger ended"] for row in table if row["automatic marks"]]
    with (export_csv(study.file, tmp_path) / "comparisons.csv").open() as file:
        assert "challenger cut short" in file.read()
