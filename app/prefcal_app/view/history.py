"""List every question and answer."""

from typing import Any

from prefcal_app.session import Interview
from prefcal_app.summary.counts import VERDICTS
from prefcal_env.preferences.answer import Preference
from prefcal_env.preferences.history import Comparison
from prefcal_scenarios.presentation.wording import marks_text

from .seen import Seen
from .sides import question_view

_WINNERS = {Preference.CHALLENGER: "new", Preference.INCUMBENT: "best", Preference.TIE: "none"}


def history_view(interview: Interview) -> dict[str, Any]:
    """Return all answers in the order given, including repeated questions, and the remarks.

    `number` counts the questions as they were asked, follow-ups among them; `answer` is the number
    for viewing and retracting.
    """
    state = interview.now().state
    asked = (c for c in state.history.comparisons if c.question is not None)
    numbers = {c.question: c.challenger for c in asked}
    numbers |= {c.question: -k for k, c in enumerate(state.history.follow_ups, start=1)}
    answers = [_answer_view(c, numbers) for c in state.answers]
    order = {answer: k for k, answer in enumerate(dict.fromkeys(a["answer"] for a in answers), 1)}
    return {
        "answers": [{**a, "number": order[a["answer"]]} for a in answers],
        "notes": [{"at": at, "text": text} for at, text in state.notes],
    }


def _answer_view(closed: Comparison, numbers: dict[int | None, int]) -> dict[str, Any]:
    again = closed.repeats is not None
    return {
        # A repeated question has the number of the original.
        "answer": numbers.get(closed.repeats if again else closed.question, closed.challenger),
        "at": closed.at,
        "challenger": closed.challenger + 1,
        "incumbent": None if closed.incumbent is None else closed.incumbent + 1,
        "text": VERDICTS[closed.answer.preference],
        "winner": _WINNERS.get(closed.answer.preference, "none"),  # type: ignore[arg-type]
        "comment": closed.comment,
        "blind": closed.blind,
        "marks": marks_text(closed.answer),
        "retracted": closed.retracted,
        "repeated": again,
        "further": closed.after is not None,
    }


def asked_view(
    interview: Interview, answer: int, *, blind: bool = False, seen: Seen | None = None
) -> dict[str, Any]:
    """Return answered question number `answer` as it was shown, on the current axes of the study.

    Raises:
        StaleError: If there is no such question.
    """
    question = interview.past.asked(answer)
    closed = interview.past.closed(answer)
    return {
        "answer": answer,
        "question": question_view(
            question, interview.scenario, blind=blind, seen=(seen or Seen()).look(interview)
        ),
        "verdict": question.choice(closed.answer.preference).value,
        "retracted": closed.retracted,
        "comment": closed.comment,
        "time_unit": question.left.experiment.channels.time_unit,
    }
