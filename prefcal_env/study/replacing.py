"""A record that was the wrong one: what its replacement does to the answers about it."""

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

from prefcal_env.preferences.answer import Answer, Mark
from prefcal_env.preferences.kpis import Outcome

from .events import Replaced

if TYPE_CHECKING:
    from .fold import Closed

_MARKS: Mapping[bool, tuple[Mark, Mark]] = {
    True: (Mark.CHALLENGER_UNSAFE, Mark.CHALLENGER_GOOD_ENOUGH),
    False: (Mark.INCUMBENT_UNSAFE, Mark.INCUMBENT_GOOD_ENOUGH),
}
"""What is said of the challenger (True) or the incumbent; unsafe first."""


def corrected(closed: "Closed", event: Replaced) -> "Closed":
    """An answer after the record of one of its sides was replaced; others stay as they are.

    The verdict and the marks were about another curve: they teach nothing any more. KPIs are those
    of the right record.
    """
    if event.index not in (closed.challenger, closed.incumbent):
        return closed
    challenger = event.index == closed.challenger
    answer = _answer(closed.answer, event, challenger)
    return replace(closed, answer=answer, retracted=closed.incumbent is not None)


def _answer(answer: Answer, event: Replaced, challenger: bool) -> Answer:
    marks = tuple(m for m in answer.marks if m not in _MARKS[challenger])
    automatic = tuple(m for m in answer.automatic if m not in _MARKS[challenger])
    if event.unsafe:
        unsafe = _MARKS[challenger][0]
        marks, automatic = (*marks, unsafe), (*automatic, unsafe)
    outcomes = answer.outcomes
    if outcomes is not None:
        right = Outcome.from_dict(event.outcome) if event.outcome else None
        outcomes = (right, outcomes[1]) if challenger else (outcomes[0], right)
    return replace(answer, marks=marks, automatic=automatic, outcomes=outcomes)
