"""What a study consists of: experiments as bytes, events, and the state that follows from them."""

import io
import struct
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import starmap
from math import prod
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any, Union

import msgspec
import numpy as np

from prefcal_env.errors import KnobError, PrefcalError, ProtocolError, StudyError
from prefcal_env.experiments.experiment import Channel, Channels, End, Experiment
from prefcal_env.knobs import Knob, KnobSpace, carry
from prefcal_env.plain import UNREADABLE, canonical, to_plain
from prefcal_env.preferences.answer import Answer, Outcome
from prefcal_env.preferences.history import Comparison, History, Sample

# --- Encode experiments as bytes: a JSON header, then little-endian arrays. Nothing is pickled.

MAGIC = b"prefcal1"
_MOST = 1 << 30  # maximum size of an experiment in bytes: a file from elsewhere may try to fill the memory
LONGEST_HEADER = 1 << 16
"""Number of bytes that hold the whole header of most experiments."""
_FLOATS = ("theta", "t", "x", "u", "t_control", "u_control", "y_ref", "solve_time")
_DTYPES = {**dict.fromkeys(_FLOATS, "<f8"), "iterations": "<i8", "solved": "|b1"}

Size = Annotated[int, msgspec.Meta(ge=0, le=_MOST)]
_Words = tuple[str, str, str]
"""Name, unit and symbol of a channel; its limits, target and band are in an array."""


class _Header(msgspec.Struct, frozen=True, omit_defaults=True, forbid_unknown_fields=True):
    """Everything about an experiment except its arrays, which follow in the order of `layout`.

    For outputs that are states, `y_states` has the number of each state; for others, `y_shape` is the
    shape of their array. Both are None without outputs.
    """

    shapes: dict[str, tuple[Size, ...]]
    signals: tuple[str, ...]
    kpis: tuple[str, ...]
    end: End
    time_unit: str
    x: tuple[_Words, ...]
    u: tuple[_Words, ...]
    y: tuple[_Words, ...]
    runs: tuple["_Header", ...] = ()
    y_states: tuple[Size, ...] | None = None
    y_shape: tuple[Size, Size] | None = None
    maneuver: str = ""

    def layout(self) -> dict[str, tuple[Sequence[int], str]]:
        """Return shape and type of each array in order, without those of the other runs."""
        found: dict[str, tuple[Sequence[int], str]] = {
            **{name: (self.shapes[name], dtype) for name, dtype in _DTYPES.items()},
            "signals": ((len(self.signals), *self.shapes["t"][:1]), "<f8"),
            "kpis": ((len(self.kpis),), "<f8"),
            "limits": ((len(self.x + self.u + self.y), 4), "<f8"),
        }
        return found if self.y_shape is None else {**found, "y": (self.y_shape, "<f8")}


class _Beginning(msgspec.Struct, frozen=True):
    """Part of a header that is read without the rest."""

    end: End


def encode(experiment: Experiment) -> bytes:
    """Return an experiment as bytes, uncompressed; equal experiments give equal bytes."""
    found = _header(experiment)
    header = canonical(to_plain(found)).encode()
    return b"".join((MAGIC, struct.pack("<I", len(header)), header, *_arrays(found, experiment)))


def decode(content: bytes) -> Experiment:
    """Return the experiment in bytes that `encode` returned.

    Raises:
        StudyError: If they are anything else.
    """
    try:
        if content[:8] != MAGIC:
            raise ValueError("it does not begin like one")
        (size,) = struct.unpack_from("<I", content, 8)
        header = msgspec.json.decode(content[12 : 12 + size], type=_Header)
        buffer = io.BytesIO(content[12 + size :])
        experiment = _experiment(header, buffer)
        if buffer.read(1):
            raise ValueError("something follows its arrays")
    except (*UNREADABLE, KeyError, struct.error, MemoryError, PrefcalError) as error:
        raise StudyError(f"a stored experiment cannot be read: {error}") from error
    return experiment


def end_of(beginning: bytes) -> End | None:
    """Return how an experiment ended, from the `beginning` of its packed bytes; None if unknown."""
    try:
        content = zlib.decompressobj().decompress(beginning, LONGEST_HEADER)
        (size,) = struct.unpack_from("<I", content, 8)
        return msgspec.json.decode(content[12 : 12 + size], type=_Beginning).end
    except (*UNREADABLE, zlib.error, struct.error):
        return None


def pack(content: bytes) -> bytes:
    """Compress bytes."""
    return zlib.compress(content, 6)


def unpack(content: bytes) -> bytes:
    """Decompress bytes up to a limit. Raises StudyError above it, or for invalid bytes."""
    stream = zlib.decompressobj()
    try:
        plain = stream.decompress(content, _MOST)
    except zlib.error as error:
        raise StudyError(f"a stored experiment cannot be decompressed: {error}") from error
    if not stream.eof or stream.unused_data:
        raise StudyError("a stored experiment is cut off, too large, or followed by something")
    return plain


def _header(experiment: Experiment) -> _Header:
    channels, y, x = experiment.channels, experiment.y, experiment.x
    states = [_state_like(curve, x) for curve in ([] if y is None else y.T)]
    # The outputs of most plants are states, so they take no space.
    known = tuple(state for state in states if state is not None)
    apart = y is not None and len(known) < len(states)
    return _Header(
        shapes={name: np.shape(getattr(experiment, name)) for name in _DTYPES},
        signals=tuple(sorted(map(str, experiment.signals))),
        kpis=tuple(experiment.kpis),
        end=experiment.end,
        time_unit=str(channels.time_unit),
        x=_words(channels.x),
        u=_words(channels.u),
        y=_words(channels.y),
        runs=tuple(map(_header, experiment.runs)),
        y_states=None if y is None or apart else known,
        y_shape=(y.shape[0], y.shape[1]) if y is not None and apart else None,
        maneuver=experiment.maneuver,
    )


def _words(channels: Sequence[Channel]) -> tuple[_Words, ...]:
    return tuple((str(c.name), str(c.unit), str(c.symbol)) for c in channels)


def _state_like(curve: np.ndarray, x: np.ndarray) -> int | None:
    return next((i for i in range(x.shape[1]) if curve.tobytes() == x[:, i].tobytes()), None)


def _arrays(header: _Header, experiment: Experiment) -> Iterator[bytes]:
    """Yield the bytes of all arrays in the order of `layout`, then those of the other runs."""
    channels = experiment.channels
    made: dict[str, Any] = {
        "signals": [experiment.signals[name] for name in header.signals],
        "kpis": [experiment.kpis[name] for name in header.kpis],
        # JSON cannot store limits, target and band, since they may be infinite.
        "limits": [
            [c.low, c.high, *(np.nan if v is None else v for v in (c.target, c.band))]
            for c in (*channels.x, *channels.u, *channels.y)
        ],
    }
    for name, (_, dtype) in header.layout().items():
        value = made[name] if name in made else getattr(experiment, name)
        yield np.ascontiguousarray(value, dtype=dtype).tobytes()
    for run, of_run in zip(experiment.runs, header.runs, strict=True):
        yield from _arrays(of_run, run)


def _experiment(header: _Header, buffer: io.BytesIO) -> Experiment:
    arrays = {name: _array(buffer, *block) for name, block in header.layout().items()}
    words = header.x + header.u + header.y
    channels = tuple(starmap(Channel, [*map(_channel_fields, words, arrays["limits"].tolist())]))
    x, u = len(header.x), len(header.x + header.u)
    outputs = arrays.get("y")
    if header.y_states is not None:
        if not all(i < arrays["x"].shape[1] for i in header.y_states):
            raise ValueError(f"outputs cannot be the states {list(header.y_states)}")
        shape = len(arrays["x"]), len(header.y_states)
        outputs = arrays["x"][:, list(header.y_states)].reshape(shape)
    return Experiment(
        **{name: arrays[name] for name in _DTYPES},
        channels=Channels(channels[:x], channels[x:u], channels[u:], header.time_unit),
        end=header.end,
        kpis=dict(zip(header.kpis, arrays["kpis"].tolist(), strict=True)),
        signals=dict(zip(header.signals, arrays["signals"], strict=True)),
        y=outputs,
        runs=tuple(_experiment(run, buffer) for run in header.runs),
        maneuver=header.maneuver,
    )


def _array(buffer: io.BytesIO, shape: Sequence[int], dtype: str) -> np.ndarray:
    size = prod(shape) * np.dtype(dtype).itemsize
    content = buffer.read(size)
    if len(content) < size:
        raise ValueError("its arrays are cut off")
    return np.frombuffer(content, dtype=dtype).reshape(shape)


def _channel_fields(words: _Words, numbers: Sequence[float]) -> tuple[Any, ...]:
    name, unit, symbol = words
    low, high, *optional = numbers
    target, band = (None if np.isnan(v) else v for v in optional)
    return name, unit, low, high, target, band, symbol


# --- Define the events of a study as frozen data, and convert them to and from JSON.
#
# A new event needs a class here and a rule in `_RULES`.

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


class Concluded(Event, frozen=True):
    """Keep what was said of the result of a study that is over, as plain data."""

    findings: Mapping[str, Any]


class Kept(Event, frozen=True):
    """Keep the θ of experiment `index` on the plant, after old and new were tried there.

    `blind` tells whether it was hidden which of the two was which.
    """

    index: Int64
    blind: bool


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


# --- Convert the knobs of a study to and from its configuration.


class _Stored(msgspec.Struct, frozen=True):
    """Knobs, and the searched part of each knob by its name."""

    knobs: tuple[Knob, ...]
    within: dict[str, tuple[float, float]] = {}


def knobs_as_dicts(space: KnobSpace) -> list[dict[str, Any]]:
    """Return the knobs as plain data."""
    return [
        {
            "name": k.name,
            "low": float(k.low),
            "high": float(k.high),
            "unit": k.unit,
            "scale": k.scale,
            "integer": bool(k.integer),
        }
        for k in space
    ]


def within_as_dict(space: KnobSpace) -> dict[str, list[float]]:
    """Return the searched part of each knob as plain data."""
    return {name: list(part) for name, part in zip(space.names, space.within, strict=True)}


def space_of(configuration: Mapping[str, Any]) -> KnobSpace:
    """Return the space of plain data with "knobs", and perhaps "within"; others are ignored.

    Raises:
        StudyError: If the knobs cannot be read.
    """
    try:
        stored = msgspec.convert(dict(configuration), _Stored)
        return KnobSpace(stored.knobs, within=stored.within)
    except (*UNREADABLE, TypeError) as error:
        raise StudyError(f"the knobs of the study cannot be read: {error}") from error


# --- Compute the state of a study from its events, one by one, without side effects.


@dataclass(frozen=True, slots=True)
class State:
    """State of a study after its events. Indices count samples from 0.

    Args:
        configuration: Configuration of the study, with all later changes.
        created: Time at which the study was started.
        n_max: Total number of planned experiments.
        history: Samples as they ran, and answers.
        proposed: Proposed θ by index, for samples that ran with another θ.
        requested: Indices of the samples that the person asked for.
        finished: Number of the event that has the experiment, by index.
        failures: Error of a run without an experiment, by index.
        marks: Marks of the experiment, by index.
        notes: Time and text of each remark.
        open: Id and event of the open question.
        ended: Why the study is over; None while it is not.
        concluded: What was said of the result; None while it is not, and once the record is another one.
        kept: Number, time and event that says what stays on the plant; None as `concluded`.
        confirmed: How often that was said, withdrawn or not.
        reopened: Whether it was over before, and went on.
    """

    configuration: Mapping[str, Any]
    created: str
    n_max: int
    history: History = field(default_factory=History)
    proposed: Mapping[int, tuple[float, ...]] = field(default_factory=dict)
    requested: frozenset[int] = frozenset()
    finished: Mapping[int, int] = field(default_factory=dict)
    failures: Mapping[int, str] = field(default_factory=dict)
    marks: Mapping[int, frozenset[str]] = field(default_factory=dict)
    notes: tuple[tuple[str, str], ...] = ()
    open: tuple[int, Shown] | None = None
    ended: str | None = None
    concluded: Mapping[str, Any] | None = None
    kept: tuple[int, str, Kept] | None = None
    confirmed: int = 0
    reopened: bool = False

    @property
    def answers(self) -> tuple[Comparison, ...]:
        """Return all answers about two experiments in order, including repeated questions."""
        history = self.history
        every = (*history.comparisons[1:], *history.follow_ups, *history.repeats)
        return tuple(sorted(every, key=lambda c: c.seq))


_KNOWN = ("finished", "failures", "marks", "proposed")
"""Fields of `State` with what is known about samples, by index."""


def begin(seq: int, at: str, event: Event) -> State:
    """Return the state after the first event.

    Raises:
        StudyError: If it is not a Created with an integer `n_max`.
    """
    n_max = event.configuration.get("n_max") if isinstance(event, Created) else None
    if not isinstance(event, Created) or type(n_max) is not int or n_max < 1:
        raise StudyError(f"event {seq}: a study begins with its configuration and its n_max")
    return State(MappingProxyType(dict(event.configuration)), at, n_max)


def step(state: State, seq: int, at: str, event: Event) -> State:
    """Return the state after one more event.

    Raises:
        StudyError: If the event is impossible in `state`; the error names its number.
    """
    rule = _RULES.get(type(event))
    if rule is None:
        raise StudyError(f"event {seq}: there is no rule for {type(event).__name__}")
    try:
        after = rule(state, seq, at, event)
    except ProtocolError as error:
        raise StudyError(f"event {seq} is impossible: {error}") from error
    # What was said and confirmed is about one result alone: a retraction after the end can give another one.
    same = after.history is state.history and after.ended == state.ended
    return after if same else replace(after, concluded=None, kept=None)


def _require(holds: bool, seq: int, otherwise: str) -> None:
    if not holds:
        raise StudyError(f"event {seq} is impossible: {otherwise}")


def _sample(state: State, seq: int, index: int) -> None:
    _require(0 <= index < len(state.history.samples), seq, f"sample {index} was never proposed")


def _suggested(state: State, seq: int, _at: str, event: Suggested) -> State:
    _require(event.index == len(state.history.samples), seq, f"sample {event.index} is not due")
    _require(len(event.z) == len(event.theta) > 0, seq, "z and theta differ in length")
    # No question is open here, except one that changed settings have made obsolete.
    return replace(state, history=state.history.with_another(Sample(event.z, event.theta)), open=None)


def _taken(state: State, _seq: int, _at: str, event: Taken) -> State:
    return replace(_arranged(state, state.history.taken(event.index)), open=None)


def _led(state: State, seq: int, _at: str, event: Led) -> State:
    compared = 0 <= event.index < state.history.answered
    _require(compared, seq, f"sample {event.index} was not compared")
    return replace(state, history=state.history.with_best(event.index))


def _arranged(state: State, order: Sequence[int]) -> State:
    """Return the state with the samples of these present indices, and what is known of them."""
    now = {index: number for number, index in enumerate(order)}
    maps: dict[str, Any] = {
        name: {now[i]: value for i, value in getattr(state, name).items() if i in now} for name in _KNOWN
    }
    requested = frozenset(now[i] for i in state.requested if i in now)
    return replace(state, history=state.history.arranged(order), requested=requested, **maps)


def _finished(state: State, seq: int, _at: str, event: Finished) -> State:
    _sample(state, seq, event.index)
    earlier = event.same_as is None or 0 < event.same_as < seq
    _require(earlier, seq, f"event {event.same_as} is no earlier one")
    failures = {i: e for i, e in state.failures.items() if i != event.index}
    source = seq if event.same_as is None else event.same_as
    return replace(state, finished={**state.finished, event.index: source}, failures=failures)


def _failed(state: State, seq: int, _at: str, event: Failed) -> State:
    _sample(state, seq, event.index)
    return replace(state, failures={**state.failures, event.index: event.error})


def _dialed(state: State, seq: int, _at: str, event: Dialed) -> State:
    due, was = state.history.answered, state.history.pending
    if was is None or event.index != due:
        raise StudyError(f"event {seq} is impossible: sample {event.index} is not open")
    _require(len(event.z) == len(event.theta) == len(was.z), seq, "z and theta differ in length")
    proposed = {due: was.theta, **state.proposed}  # dialed twice: keep the proposed θ
    history = state.history.with_pending(Sample(event.z, event.theta))
    return replace(state, history=history, proposed=proposed)


def _requested(state: State, seq: int, _at: str, event: Requested) -> State:
    due, known = state.history.answered, state.history.samples[:1]
    _require(event.index == due, seq, f"sample {due} is due, not {event.index}")
    _require(state.ended is None and due < state.n_max, seq, "nothing is left to be tried")
    size = len(known[0].z) if known else len(event.z)
    _require(len(event.z) == len(event.theta) == size > 0, seq, "z and theta differ in length")
    # All that is known about the sample in its place is about another θ.
    others: dict[str, Any] = {
        name: {i: value for i, value in getattr(state, name).items() if i != due} for name in _KNOWN
    }
    return replace(
        state,
        history=state.history.with_pending(Sample(event.z, event.theta)),
        requested=state.requested | {due},
        **others,
        open=None,
    )


def _replaced(state: State, seq: int, _at: str, event: Replaced) -> State:
    _require(event.index in state.finished, seq, f"there is no experiment of sample {event.index}")
    _require(state.ended is None, seq, "the study is over")
    outcome = Outcome.from_dict(event.outcome) if event.outcome else None
    return replace(
        state,
        history=state.history.corrected(event.index, outcome, unsafe=event.unsafe),
        marks={i: m for i, m in state.marks.items() if i != event.index},
    )


def _shown(state: State, seq: int, _at: str, event: Shown) -> State:
    for index in (event.challenger, event.incumbent):
        _require(index in state.finished, seq, f"there is no experiment of sample {index}")
    _require(event.challenger != event.incumbent, seq, "an experiment is not compared with itself")
    return replace(state, open=(seq, event))


def _marked(state: State, seq: int, _at: str, event: Marked) -> State:
    index, mark = event.index, event.mark
    _sample(state, seq, index)
    _require(mark in MARKS, seq, f"a mark must be one of {MARKS}, got {mark!r}")
    # One mark excludes the other: the last one holds.
    now = frozenset({mark}) if event.on else state.marks.get(index, frozenset()) - {mark}
    return replace(state, marks={**state.marks, index: now})


def _answered(state: State, seq: int, at: str, event: Answered) -> State:
    shown = None if state.open is None or state.open[0] != event.question else state.open[1]
    pair = None if shown is None else (shown.challenger, shown.incumbent)
    if event.question is None and event.incumbent is None:
        _require(
            event.challenger == 0 == state.history.answered,
            seq,
            "only the first experiment is compared with nothing",
        )
        _require(0 in state.finished, seq, "there is no experiment of sample 0")
    elif event.question is None:
        for index in (event.challenger, event.incumbent):
            _require(index in state.finished, seq, f"there is no experiment of sample {index}")
    else:
        _require(pair == (event.challenger, event.incumbent), seq, f"question {event.question} is not open")
    answer = Comparison(
        event.challenger,
        event.incumbent,
        event.answer,
        seq=seq,
        at=at,
        question=event.question,
        challenger_left=None if shown is None else shown.challenger_left,
        comment=event.comment,
        blind=event.blind,
        repeats=None if shown is None else shown.repeats,
    )
    due = state.history.answered
    about_known = answer.repeats is not None or (shown is not None and event.challenger < due)
    is_due = about_known or event.challenger == due
    _require(is_due, seq, f"sample {due} is due, not {event.challenger}")
    return replace(state, history=state.history.recorded(answer), open=None)


def _retracted(state: State, _seq: int, _at: str, event: Retracted) -> State:
    follow_up = event.answer < 0
    number = -event.answer - 1 if follow_up else event.answer
    return replace(state, history=state.history.retracted(number, follow_up=follow_up))


def _undone(state: State, seq: int, _at: str, _event: Undone) -> State:
    _require(state.history.answered > 0, seq, "there is no answer to undo")
    kept = _arranged(state, state.history.undoing())
    return replace(kept, history=state.history.undone(), open=None, ended=None)


def _noted(state: State, _seq: int, at: str, event: Noted) -> State:
    return replace(state, notes=(*state.notes, (at, event.text)))


def _extended(state: State, seq: int, _at: str, event: Extended) -> State:
    holds = event.n_max >= state.history.answered
    _require(holds, seq, f"n_max {event.n_max} is below what is answered")
    return replace(state, n_max=event.n_max)


def _ended(state: State, _seq: int, _at: str, event: Ended) -> State:
    return replace(state, ended=event.reason, open=None)


def _concluded(state: State, seq: int, _at: str, event: Concluded) -> State:
    _require(state.ended is not None, seq, "the study is not over")
    return replace(state, concluded=event.findings)


def _kept(state: State, seq: int, at: str, event: Kept) -> State:
    _require(state.ended is not None, seq, "the study is not over")
    _require(event.index in state.finished, seq, f"there is no experiment of sample {event.index}")
    return replace(state, kept=(seq, at, event), confirmed=state.confirmed + 1)


def _reopened(state: State, _seq: int, _at: str, _event: Reopened) -> State:
    return replace(state, ended=None, reopened=True)


def _created(_state: State, seq: int, _at: str, _event: Created) -> State:
    raise StudyError(f"event {seq}: a study is created once")


def _adjusted(state: State, seq: int, _at: str, event: Adjusted) -> State:
    agent: Any = state.configuration.get("agent")
    before = agent.get("settings") if isinstance(agent, Mapping) else None
    if not isinstance(before, Mapping):
        raise StudyError(f"event {seq} is impossible: the agent of the study has no settings")
    changed = {**agent, "settings": {**before, **event.settings}}
    configuration = MappingProxyType({**state.configuration, "agent": changed})
    return replace(state, configuration=configuration)


def _respaced(state: State, seq: int, _at: str, event: Respaced) -> State:
    due, samples = state.history.answered, range(len(state.history.samples))
    kept = _arranged(state, [i for i in samples if i < due or i in state.finished])
    expected = {"knobs", "within", "scenario_knobs"}
    _require(set(event.space) == expected, seq, f"its space must have {sorted(expected)}")
    agent = state.configuration.get("agent", {})
    _require(isinstance(agent, Mapping), seq, "the study has no agent")
    configuration = {**state.configuration, **event.space, "agent": {**agent, **event.agent}, "respaced": seq}
    old, new = space_of(state.configuration), space_of(configuration)
    space_of({"knobs": event.space["scenario_knobs"]})
    try:
        history = kept.history.moved(old, new, event.added)
        proposed = {
            i: tuple(carry(np.array(theta), old, new, event.added).tolist())
            for i, theta in kept.proposed.items()
        }
    except (KnobError, TypeError, ValueError) as error:
        raise StudyError(f"event {seq} is impossible: {error}") from error
    return replace(kept, configuration=MappingProxyType(configuration), history=history, proposed=proposed)


_RULES: Mapping[type[Event], Callable[[State, int, str, Any], State]] = {
    Created: _created,
    Suggested: _suggested,
    Taken: _taken,
    Led: _led,
    Dialed: _dialed,
    Requested: _requested,
    Finished: _finished,
    Replaced: _replaced,
    Failed: _failed,
    Shown: _shown,
    Answered: _answered,
    Marked: _marked,
    Retracted: _retracted,
    Undone: _undone,
    Noted: _noted,
    Extended: _extended,
    Ended: _ended,
    Concluded: _concluded,
    Kept: _kept,
    Reopened: _reopened,
    Respaced: _respaced,
    Adjusted: _adjusted,
}
"""Rule of each event: state, number, time and event to the next state."""
