"""Why a question is asked and the offer to stop, in the terminal."""

import io

import pytest
from rich.console import Console

from prefcal_agents.screening.agent import Screening
from prefcal_agents.screening.reason import Reason
from prefcal_app.session import Background
from prefcal_app.terminal import converse
from prefcal_app.terminal.showing import show_question
from support.interviews import begin, proceed
from support.looks import toy
from support.screened import screening

FIRST, WHY = "Nothing learned yet: ", "(chance that you prefer it: 70 %)."
OFFER = "Stop here, or go on? (f, and f again, finishes)"


@pytest.fixture(autouse=True)
def says(monkeypatch):
    """An agent with reasons that promises nothing more."""
    reason = Reason(0.7, ("final",), ("t_f",))
    monkeypatch.setattr(Screening, "reason", property(lambda agent: reason))
    monkeypatch.setattr(Screening, "chance_of_better", property(lambda agent: 0.08))


def talk(interview, keys, width=200):
    """What was printed for these keys."""
    console = Console(file=io.StringIO(), width=width, record=True, force_terminal=False)
    typed = iter(keys)
    with Background(interview):
        converse(interview, console, lambda words: next(typed))
    return console.export_text()


def test_each_question_has_its_reason_and_after_an_answer_the_offer():
    first, _, second = talk(screening(), "lx").partition("Saved: left.")
    assert FIRST in first
    assert OFFER not in first
    assert WHY in second
    assert "simulated is better than the best so far is 8 %" in second
    assert OFFER in second


def test_blind_hides_the_reason_and_keeps_the_offer():
    *_, blind = talk(screening(), "lbx").rpartition(OFFER.split("?")[0])
    out = talk(screening(), "lbx")
    assert (out.count(FIRST), out.count(WHY)) == (1, 1)  # of two open questions
    assert out.count(OFFER) == 2
    assert WHY not in blind


def test_where_are_we_tells_what_the_simulations_promise():
    out = talk(screening(), "llwx")
    assert "simulated is better than the best so far is 8 %" in out.partition("Saved: left.")[2]
    assert "would bring nothing better" not in out


def test_other_agents_give_no_reason():
    interview = begin(toy)
    now = proceed(interview)
    console = Console(file=io.StringIO(), width=120, record=True)
    show_question(interview, now, console, blind=False)
    assert "shown because" not in console.export_text()
