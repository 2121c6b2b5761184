"""The page and the terminal tell in one line how many experiments were simulated unseen."""

import json
from functools import partial
from io import StringIO

import numpy as np
import pytest
from rich.console import Console

from prefcal_agents.screening.agent import Screening
from prefcal_app.terminal.converse import _Conversation, _waiting
from prefcal_app.view import now_view, status_view
from support.interviews import begin, proceed
from support.talking import talk
from support.unseen import unseen


@pytest.fixture
def interview():
    return begin(unseen, n_max=4, agent=partial(Screening, n_simulated=40))


def test_the_page_is_told_before_and_during_a_question(interview):
    before = now_view(interview)
    assert before["simulated"]["line"] == "0 simulated, 0 shown"
    now = proceed(interview)
    assert now.simulated.going_on == ""
    view = now_view(interview)["simulated"]
    assert view["line"] == now.simulated.line
    assert (view["planned"], view["shown"]) == (40, 2)
    assert status_view(interview)["simulated"] == view
    json.dumps(view, allow_nan=False)


def test_it_is_told_how_many_of_how_many_while_they_are_simulated(interview, monkeypatch):
    monkeypatch.setattr("prefcal_app.simulating.simulator._TELL", 0.0)
    told, simulator = [], interview._driver.thoughts.simulator
    tell = simulator.tell
    simulator.tell = lambda: (tell(), told.append(_waiting(interview.now())))
    assert proceed(interview).simulated.going_on == ""
    assert told == [f"choosing the next experiment ({k} of 11 simulated)" for k in range(11)]


def test_the_terminal_tells_while_it_waits_and_in_the_status(interview):
    waiting = _waiting(interview.now())
    assert waiting == "choosing the next experiment (0 simulated, 0 shown)"
    out = talk(interview, "wlx")
    assert " simulated, 2 shown" in out
    assert out.count("Question 1 of 3") == 1  # not once more for each simulation


def measured_as(interview, seconds):
    """Let varied runs count as measured, so many seconds each."""
    pace = interview._driver.thoughts.simulator._times
    pace.begin()
    for k in range(21):
        pace.arrived(1, seconds * k)


def test_a_log_has_a_line_for_each_tenth_of_the_varied_runs_that_take_long(interview):
    simulator, console = interview._driver.thoughts.simulator, Console(file=StringIO(), width=200)
    conversation = _Conversation(interview, console, lambda words: "x")
    simulator.varied = 290, 300
    assert interview.now().simulated.going_on == "290 of 300 varied runs"
    conversation._tell_pace(interview.now().simulated)
    assert console.file.getvalue() == ""  # not measured: nobody waits long
    measured_as(interview, 0.1)
    for done in (0, 29, 30, 31, 59, 60, 300):
        simulator.varied = done, 300
        conversation._tell_pace(interview.known.simulated)
    _, *lines = console.file.getvalue().splitlines()
    assert lines == [f"{done} of 300 varied runs" for done in (30, 60, 300)]


def test_how_long_a_question_takes_is_said_once_in_the_terminal_and_on_the_page(interview):
    interview._driver.thoughts.simulator.holds = lambda thetas, runs: np.ones(
        (len(thetas), len(runs)), dtype=bool
    )
    measured_as(interview, 0.1)
    said = (
        "A question takes about 30 s if the first tuning that is tried on 300 plants holds there, and can "
        "take several times as long if not."
    )
    assert now_view(interview)["simulated"]["pace"] == said
    out = " ".join(talk(interview, "<<x").split())
    assert out.count(said) == 1
