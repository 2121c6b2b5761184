"""Runs that left no record, in the report and in what the page shows."""

from dataclasses import replace

import pytest

from prefcal_app.cli.options import Options
from prefcal_app.cli.result import record_of
from prefcal_app.report.write import write_report
from prefcal_app.session import Choice, Phase, actions
from prefcal_app.view import history_view, now_view, status_view
from support.interviews import begin, proceed
from toy_study import toy_scenario


def interview_with_failures(failing, choice, scenario="toy"):
    """A study in which the runs numbered `failing` are counted as failed."""
    toy = toy_scenario(scenario)
    count = []

    def run(theta, seed=0):
        count.append(theta)
        if len(count) - 1 in failing:
            raise OSError("no signal")
        return toy.run(theta, seed)

    interview = begin(replace(toy, run=run), n_max=6)
    while (now := proceed(interview)).phase is not Phase.OVER:
        if now.phase is Phase.FAILED:
            interview.do(actions.Fail(now.pending.index, "no signal"))
        else:
            now_view(interview)
            interview.do(actions.Answer(now.question.id, choice))
    return interview


@pytest.mark.parametrize(
    ("scenario", "failing"),
    [("toy", (0,)), ("toy", (1, 3)), ("toy", range(6)), ("plain", (5,)), ("plain", (0, 1))],
    ids=str,
)
def test_a_report_is_written_whatever_failed(tmp_path, scenario, failing):
    interview = interview_with_failures(failing, Choice.LEFT, scenario)
    references = {} if scenario == "plain" else {"paper": interview.scenario.run([0.31, 26, 0.5])}
    record = record_of(interview, Options("toy"), references)
    report = write_report(record, tmp_path)
    assert "</html>" in report.read_text("utf-8")


@pytest.mark.parametrize("failing", [(0,), (1,), (0, 1), range(6)], ids=str)
def test_the_page_shows_what_failed(failing):
    interview = interview_with_failures(failing, Choice.RIGHT)
    over = now_view(interview)["over"]
    assert over["reason"] == "all compared"
    assert len(history_view(interview)["answers"]) == 5
    ended = [e["ended"] for e in status_view(interview)["tried"]["experiments"]]
    assert [i for i, words in enumerate(ended) if words == "failed"] == list(failing)
