"""Interrupted runs mark themselves: from the interview to the agent, the file and every view."""

import csv
import io
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from prefcal_agents.lessons import Marks
from prefcal_app.session import Choice, Phase, actions
from prefcal_app.terminal.showing import show_history, show_question
from prefcal_app.view import history_view, now_view, status_view
from prefcal_env.experiments.experiment import End
from prefcal_env.preferences.answer import Mark
from prefcal_env.study import export_csv
from support.interviews import begin, proceed, worked
from toy_study import toy_scenario

NEW, OLD = Mark.CHALLENGER_UNSAFE, Mark.INCUMBENT_UNSAFE
WORDS = "unsafe: run interrupted"
toy = toy_scenario()


def run(theta, seed=0):
    """The toy, unsafe for gains above 0.45 and failed below 0.05."""
    end = End.UNSAFE if theta[2] > 0.45 else End.FAILED if theta[2] < 0.05 else End.TIME_UP
    return replace(toy.run(theta), end=end)


touchy = replace(toy, run=run)


def answer(interview, choice=Choice.SAME):
    now = proceed(interview)
    return interview.do(actions.Answer(now.question.id, choice))


def studied(answers=6, **more):
    interview = begin(touchy, n_max=9, **more)
    for _ in range(answers):
        answer(interview)
    proceed(interview)
    return interview


def test_the_agent_learns_them_and_a_retraction_takes_them_along():
    interview = studied()
    unsafe = [i for i in range(7) if interview.past.experiment(i).end is End.UNSAFE]
    history = interview._driver.agent.state.history
    assert np.flatnonzero(Marks.of(history).unsafe).tolist() == unsafe
    assert interview.now().state.history.interrupted == set(unsafe)
    last = max(i for i in unsafe if i)
    interview.do(actions.Retract(last))
    assert interview.now().state.history.interrupted == set(unsafe) - {last}
    assert Marks.of(interview._driver.agent.state.history).unsafe.sum() == len(unsafe) - 1
    assert not interview.past.comparisons()[last].answer.preference
    assert interview.past.comparisons()[last].answer.automatic


@pytest.mark.parametrize("mark", ["", "unsafe", "good enough"])
def test_running_ahead_foresees_them(mark):
    interview = begin(touchy, n_max=5, ahead=True)
    while (now := proceed(interview)).phase is Phase.QUESTION:
        if mark and not (mark == "good enough" and now.question.left.counts_as_unsafe):
            interview.do(actions.Mark(now.question.id, "left", mark, True))
        worked(interview)
        now = interview.do(actions.Answer(interview.now().question.id, Choice.SAME))
        assert now.phase is not Phase.RUNNING  # nothing was left to compute
    assert any(c.answer.automatic for c in now.state.history.comparisons)


def test_every_view_and_table_says_so_and_why(tmp_path):
    interview = studied()
    state = interview.now().state
    rows = history_view(interview)["answers"]
    assert [f"first: {WORDS}" in row["marks"] for row in rows] == [
        NEW in c.answer.automatic for c in state.answers
    ]
    tried = status_view(interview)["tried"]["experiments"]
    shown = {e["number"] - 1 for e in tried if WORDS in e["marks"]}
    assert shown == state.history.interrupted != set()
    with (export_csv(interview.file, tmp_path) / "experiments.csv").open() as file:
        marked = {i for i, row in enumerate(csv.DictReader(file)) if row["automatic marks"]}
    assert marked == shown
    question = interview.now().question
    view = now_view(interview, blind=True)["question"]
    for name in ("left", "right"):
        assert view[name]["counts_as_unsafe"] == getattr(question, name).counts_as_unsafe
    console = Console(file=io.StringIO(), width=200, record=True)
    show_history(history_view(interview)["answers"], console)
    show_question(now_view(interview), console)
    out = console.export_text()
    assert f"first: {WORDS}" in out
    assert out.split("History")[1].count(f"· {WORDS}") == sum(
        side.counts_as_unsafe for side in (question.left, question.right)
    )
