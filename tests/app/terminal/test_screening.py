"""Why a question is asked and the offer to stop, in the terminal."""

import pytest

from prefcal_agents.screening.findings import Reason
from support.screened import let_say, screening
from support.talking import talk

FIRST, WHY = "Nothing learned yet: ", "(chance that you prefer it: 70 %)."
OFFER = "Stop here, or go on? (f, and f again, finishes)"


@pytest.fixture(autouse=True)
def says(monkeypatch):
    """An agent with reasons that promises nothing more."""
    let_say(monkeypatch, reason=Reason(0.7, ("final",), ("t_f",)), chance_of_better=0.08)


def test_each_question_has_its_reason_and_after_an_answer_the_offer():
    first, _, second = talk(screening(), "lx", width=200).partition("Saved: left.")
    assert FIRST in first
    assert OFFER not in first
    assert WHY in second
    assert "simulated is better than the best so far is 8 %" in second
    assert OFFER in second
