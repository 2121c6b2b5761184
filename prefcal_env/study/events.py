"""Define the events of a study as frozen data, and convert them to and from JSON.

A new event needs a class here and a rule in `fold.py`.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, Union

import msgspec

from prefcal_env.errors import StudyError
from prefcal_env.plain import UNREADABLE, canonical, to_plain
from prefcal_env.preferences.answer import Answer

Int64 = Annotated[int, msgspec.Meta(ge=-(2**63), le=2**63 - 1)]
"""Whole number that a study file and SQLite can store."""

MARKS = ("unsafe", "good enough")
"""Marks of an experiment; setting one removes the other."""


class Event(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag=str.lower):
    """Base of all events; the JSON text names the class in lower case as its "kind"."""


class Created(Event, frozen=True):
    """Start the study; `configuration` is nested plain data."""

    configuration: Mapping[str, Any]


class Suggested(Event, frozen=True):
    """Propose sample `index`, from 0: `z` in the unit cube, `theta` physical, each (n,).

    Several can be pending. After an undo, another sample of the same index takes its place.
    """

    index: Int64
    z: tuple[float, ...]
    theta: tuple[float, ...]


class Taken(Event, frozen=True):
    """Compare pending sample `index` next, before those that were proposed earlier.

    It gets the number of the next one, and those before it one more each.
    """

    index: Int64


class Led(Event, frozen=True):
    """Hold sample `index` for the best until the next answer: single answers can be wrong."""

    index: Int64


class Finished(Event, frozen=True):
    """Add the experiment of sample `index`: the payload of this event, or of event `same_as`."""

    index: Int64
    same_as: Int64 | None = None


class Dialed(Event, frozen=True):
    """Run sample `index`, the next one to be answered, at another θ than was proposed.

    `z` in the unit cube and `theta` physical, each (n,), are the sample from now on; the proposed
    values stay in its `Suggested`.
    """

    index: Int64
    z: tuple[float, ...]
    theta: tuple[float, ...]


class Requested(Event, frozen=True):
    """Try a θ that the person asks for as sample `index`, the next one to be answered.

    It replaces the proposed sample, if there is one that is not answered yet: the θ of that is free
    again, and an open question is withdrawn. `z` in the unit cube, `theta` physical, each (n,).
    """

    index: Int64
    z: tuple[float, ...]
    theta: tuple[float, ...]


class Replaced(Event, frozen=True):
    """Replace the wrong record of sample `index`; a Finished with the right one follows.

    Answers about the wrong record no longer teach anything. `outcome` holds the KPIs of the right
    record, empty if unknown, and `unsafe` tells whether its run was interrupted as unsafe.
    """

    index: Int64
    outcome: Mapping[str, Any]
    unsafe: bool


class Failed(Event, frozen=True):
    """Note that the run of sample `index` raised an error; it may be tried again."""

    index: Int64
    error: str


class Shown(Event, frozen=True):
    """Show a question; its id is the number of this event.

    `repeats` is the id of the earlier question that is asked again.
    """

    challenger: Int64
    incumbent: Int64
    challenger_left: bool
    repeats: Int64 | None = None


class Answered(Event, frozen=True):
    """Close the open question; `question` and `incumbent` are None for the first experiment.

    If a score was given instead of a preference, no question was shown: only `question` is None.
    """

    question: Int64 | None
    challenger: Int64
    incumbent: Int64 | None
    answer: Answer
    comment: str = ""
    blind: bool = False


class Marked(Event, frozen=True):
    """Set `mark` on experiment `index`, or remove it."""

    index: Int64
    mark: str
    on: bool


class Retracted(Event, frozen=True):
    """Ignore closed query number `answer` from now on; all samples stay.

    A negative number -k is the k-th answer to a follow-up comparison, of two earlier experiments.
    """

    answer: Int64


class Undone(Event, frozen=True):
    """Undo the last answer: its query is open again, and samples proposed since are dropped."""


class Noted(Event, frozen=True):
    """Add a remark on the study."""

    text: str


class Extended(Event, frozen=True):
    """Change the total number of experiments to `n_max`."""

    n_max: Int64


class Ended(Event, frozen=True):
    """End the study: all is compared, little is left, the best is good enough, or the person finished it."""

    reason: str


class Reopened(Event, frozen=True):
    """Continue the study after its end."""


class Respaced(Event, frozen=True):
    """Change the knobs or their ranges; all samples so far stay.

    `space` is plain data: "knobs" and "within" as read by `spaces.space_of`, and "scenario_knobs",
    the knobs of the scenario. `added` has the value of each new knob in earlier experiments.
    `agent` has the new values of the agent's configuration that depend on the space. A sample that
    has not run yet is dropped.
    """

    space: Mapping[str, Any]
    added: Mapping[str, float]
    agent: Mapping[str, Any] = {}


class Adjusted(Event, frozen=True):
    """Change settings of the agent; those not in `settings` stay.

    The agent decides which settings can change during a study, and what the change does.
    """

    settings: Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Recorded:
    """Event with its number, from 1, and the time of its recording."""

    seq: int
    at: str
    event: Event


if TYPE_CHECKING:
    AnyEvent = Event
else:
    AnyEvent = Union[tuple(Event.__subclasses__())]  # noqa: UP007
"""Union of all event types above; the "kind" tells which one to read."""
_DECODER: msgspec.json.Decoder[Event] = msgspec.json.Decoder(AnyEvent)


def to_text(event: Event) -> str:
    """Return the JSON text of an event; equal events give equal text.

    Raises:
        StudyError: If it holds something that `from_text` could not read back.
    """
    try:
        text = canonical(to_plain(event))
        _DECODER.decode(text)  # a field of another type would make the file unreadable
    except (*UNREADABLE, TypeError) as error:
        raise StudyError(f"{type(event).__name__} cannot be recorded: {error}") from error
    return text


def from_text(text: str) -> Event:
    """Return the event in a text that `to_text` returned.

    Raises:
        StudyError: If the text is not JSON, or a kind or field is invalid, which the error names.
    """
    try:
        return _DECODER.decode(text)
    except UNREADABLE as error:
        raise StudyError(f"an event cannot be read: {error}") from error
