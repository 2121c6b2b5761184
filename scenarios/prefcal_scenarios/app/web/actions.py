"""Define the actions of the page: the fields of each request and the method that handles it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from prefcal_scenarios.app.session import Choice, Interview

from .bodies import Check, at_most, between, flag, numbered, one_of, reals, text, whole

MOST_MORE = 10_000
"""Maximum number of additional experiments per request."""
MOST_QUESTIONS = 99
"""Maximum number of comparisons for each experiment; no ranking needs more."""


@dataclass(frozen=True, slots=True)
class Action:
    """A kind of request.

    Args:
        fields: Checks of the body's fields by name; every field is required.
        do: Function to call with the interview and, by name, the fields.
    """

    fields: Mapping[str, Check]
    do: Callable[..., Any]


def _answer(interview: Interview, choice: str, **rest: Any) -> Any:
    return interview.answer(choice=Choice(choice), **rest)


def _ask_for(interview: Interview, theta: tuple[float, ...]) -> Any:
    return interview.ask_for(np.array(theta))


def _method(name: str) -> Callable[..., Any]:
    """Return a function that calls the interview's method `name` with the fields."""

    def do(interview: Interview, **given: Any) -> Any:
        return getattr(interview, name)(**given)

    return do


ACTIONS: Mapping[str, Action] = MappingProxyType(
    {
        "answer": Action(
            {
                "question": whole,
                "choice": one_of(*(choice.value for choice in Choice)),
                "comment": text,
                "blind": flag,
            },
            _answer,
        ),
        "mark": Action(
            {
                "question": whole,
                "side": one_of("left", "right"),
                "mark": one_of("unsafe", "good enough"),
                "on": flag,
            },
            _method("mark"),
        ),
        "undo": Action({"version": whole}, _method("undo")),
        "retract": Action({"answer": numbered}, _method("retract")),
        "repeat": Action({}, _method("repeat")),
        "pace": Action({"questions": between(1, MOST_QUESTIONS)}, _method("pace")),
        "ask_for": Action({"theta": reals}, _ask_for),
        "note": Action({"text": text}, _method("note")),
        "stop_run": Action({"index": whole}, _method("stop_run")),
        "write_and_start": Action({"index": whole}, _method("write_and_start")),
        "retry": Action({"index": whole}, _method("retry")),
        "fail": Action({"index": whole, "reason": text}, _method("fail")),
        "finish": Action({}, _method("finish")),
        "go_on": Action({"more": at_most(MOST_MORE)}, _method("go_on")),
    }
)
