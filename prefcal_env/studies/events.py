"""The events of a study: everything that happened, in plain frozen data, and to and from JSON."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, fields
from math import isfinite
from typing import Any

from prefcal_env.errors import PrefcalError, StudyError
from prefcal_env.preference import Answer


@dataclass(frozen=True, slots=True)
class Created:
    """The study was begun; `configuration` is nested plain data that goes through JSON."""

    configuration: Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Suggested:
    """Sample `index`, from 0, was proposed: `z` in the unit cube, `theta` physical, each (n,).

    After an undo, another one of the same index takes its place.
    """

    index: int
    z: tuple[float, ...]
    theta: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Finished:
    """The experiment of sample `index` is there: this event's payload, or that of `same_as`."""

    index: int
    same_as: int | None = None


@dataclass(frozen=True, slots=True)
class Dialed:
    """Sample `index`, the last and not yet answered, is run at another θ than was proposed.

    `z` in the unit cube and `theta` physical, each (n,), are the sample from now on; what was
    proposed stays in its `Suggested`.
    """

    index: int
    z: tuple[float, ...]
    theta: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Replaced:
    """The record of sample `index` was the wrong one; a Finished with the right one follows.

    Answers that compared the wrong one teach nothing from now on. `outcome` is that of the right
    record, an empty one if nothing is known, and `unsafe` whether its run was interrupted so.
    """

    index: int
    outcome: Mapping[str, Any]
    unsafe: bool


@dataclass(frozen=True, slots=True)
class Failed:
    """The run of sample `index` raised; it stays open and may be tried again."""

    index: int
    error: str


@dataclass(frozen=True, slots=True)
class Shown:
    """A question is on show; its id is the number of this event.

    `repeats` is the id of the earlier question that it asks again.
    """

    challenger: int
    incumbent: int
    challenger_left: bool
    repeats: int | None = None


@dataclass(frozen=True, slots=True)
class Answered:
    """The open question is closed; `question` and `incumbent` are None for the first experiment.

    Where a score was told instead, no question was on show: `question` alone is None.
    """

    question: int | None
    challenger: int
    incumbent: int | None
    answer: Answer
    comment: str = ""
    blind: bool = False


@dataclass(frozen=True, slots=True)
class Marked:
    """Experiment `index` bears `mark` from now on, or no longer."""

    index: int
    mark: str
    on: bool


@dataclass(frozen=True, slots=True)
class Retracted:
    """Closed query number `answer` teaches nothing from now on; all samples stay.

    Below 0, further answer number -`answer`, from 1: about two experiments closed before.
    """

    answer: int


@dataclass(frozen=True, slots=True)
class Undone:
    """The last answer is taken back: its query is open again, samples after it are dropped."""


@dataclass(frozen=True, slots=True)
class Noted:
    """A remark on the study."""

    text: str


@dataclass(frozen=True, slots=True)
class Extended:
    """So many experiments are wanted in all."""

    n_max: int


@dataclass(frozen=True, slots=True)
class Ended:
    """The study is over: all is compared, the best is good enough, or the person stopped."""

    reason: str


@dataclass(frozen=True, slots=True)
class Reopened:
    """The study goes on after an end."""


@dataclass(frozen=True, slots=True)
class Respaced:
    """Other knobs, or other ranges, from now on; all that was tried stays.

    `space` is plain data: "knobs" and "within" as `spaces.space_of` reads them, and
    "scenario_knobs", those that the scenario had. `added` has the value of each new knob in the
    experiments before. A sample that has not run yet is dropped.
    """

    space: Mapping[str, Any]
    added: Mapping[str, float]


@dataclass(frozen=True, slots=True)
class Paced:
    """At most so many comparisons for each experiment from now on, 1 or more.

    A further question that is on show is put away where it would be one too many.
    """

    questions: int


MARKS = ("unsafe", "good enough")
"""What an experiment may be marked as; one mark takes the other away."""

Event = (
    Created | Suggested | Finished | Failed | Shown | Answered | Marked | Retracted | Undone
    | Noted | Extended | Ended | Reopened | Respaced | Paced | Dialed | Replaced
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Recorded:
    """An event with its number, from 1, and when it was recorded, as the clock said."""

    seq: int
    at: str
    event: Event


KINDS: Mapping[str, type[Event]] = {
    kind.__name__.lower(): kind
    for kind in (
        Created, Suggested, Finished, Failed, Shown, Answered, Marked, Retracted, Undone, Noted,
        Extended, Ended, Reopened, Respaced, Paced, Dialed, Replaced,
    )
}  # fmt: skip
"""The kinds of events by the name that they bear in a study file."""

_TYPES: Mapping[str, tuple[type, ...]] = {
    "configuration": (dict,), "space": (dict,), "added": (dict,),
    "z": (list,), "theta": (list,), "error": (str,), "comment": (str,),
    "mark": (str,), "text": (str,), "reason": (str,), "answer": (int, dict), "on": (bool,),
    "outcome": (dict,), "unsafe": (bool,),
    "blind": (bool,), "challenger_left": (bool,), "same_as": (int, type(None)),
    "repeats": (int, type(None)), "question": (int, type(None)), "incumbent": (int, type(None)),
}  # fmt: skip
"""What a field is in JSON; integers where nothing else is said."""


def to_text(event: Event) -> tuple[str, str]:
    """Kind and body of an event; equal events give equal text.

    Raises:
        StudyError: it holds something that is no plain data, or a number that is not finite.
    """
    body = {f.name: getattr(event, f.name) for f in fields(event)}
    if isinstance(event, Answered):
        body["answer"] = event.answer.to_dict()
    if isinstance(event, Created):
        body["configuration"] = dict(event.configuration)
    if isinstance(event, Respaced):
        body = {"space": dict(event.space), "added": dict(event.added)}
    if isinstance(event, Replaced):
        body["outcome"] = dict(event.outcome)
    try:
        text = canonical(body)
        text.encode()  # half of a surrogate pair is no text
        return type(event).__name__.lower(), text
    except (TypeError, ValueError) as error:
        raise StudyError(f"{type(event).__name__} is no plain data: {error}") from error


def canonical(content: Any) -> str:
    """The one JSON text of plain data: sorted keys, no spaces, finite numbers only."""
    return json.dumps(
        content, sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False
    )


def from_text(kind: str, body: str) -> Event:
    """Read what `to_text` gave; whatever else stands there is refused.

    Raises:
        StudyError: an unknown kind, not JSON, or other fields than the kind has.
    """
    if kind not in KINDS:
        raise StudyError(f"an event cannot be a {kind!r}: expected one of {sorted(KINDS)}")
    try:
        content = json.loads(body, parse_constant=_no_constant)
        event = KINDS[kind]
        names = {f.name for f in fields(event)}
        if not isinstance(content, dict) or set(content) != names:
            raise ValueError(f"expected the fields {sorted(names)}")
        return event(**{name: _value(kind, name, value) for name, value in content.items()})
    except (
        ValueError, TypeError, KeyError, OverflowError, RecursionError, PrefcalError
    ) as error:  # fmt: skip
        raise StudyError(f"event {kind!r} cannot be read: {error}") from error


def _value(kind: str, name: str, value: Any) -> Any:
    expected = _TYPES.get(name, (int,))
    if name == "answer":
        expected = (dict,) if kind == "answered" else (int,)
    if not isinstance(value, expected) or (isinstance(value, bool) and bool not in expected):
        raise ValueError(f"{name} must be {' or '.join(t.__name__ for t in expected)}")
    if isinstance(value, int) and abs(value) >= 1 << 63:
        raise ValueError(f"{name} is out of range")
    if isinstance(value, list):
        return _numbers(name, value)
    return Answer.from_dict(value) if name == "answer" and isinstance(value, dict) else value


def _no_constant(name: str) -> None:
    raise ValueError(f"{name} is no JSON")


def _numbers(name: str, values: list[Any]) -> tuple[float, ...]:
    numbers = tuple(float(v) for v in values if isinstance(v, (int, float)))
    if len(numbers) != len(values) or not all(map(isfinite, numbers)):
        raise ValueError(f"{name} must hold finite numbers")
    return numbers
