"""The state of a study, computed from its events one by one. Pure."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any

import numpy as np

from prefcal_env.errors import KnobError, StudyError
from prefcal_env.knobs.change import carried
from prefcal_env.preferences.answer import Answer
from prefcal_env.preferences.best import unsafe_indices

from .events import (
    MARKS,
    Adjusted,
    Answered,
    Created,
    Dialed,
    Ended,
    Event,
    Extended,
    Failed,
    Finished,
    Marked,
    Noted,
    Reopened,
    Replaced,
    Respaced,
    Retracted,
    Shown,
    Suggested,
    Undone,
)
from .replacing import corrected
from .spaces import space_of


@dataclass(frozen=True, slots=True)
class Closed:
    """One closed query: when and how it was answered.

    Args:
        seq: Number of its Answered event.
        at: When, as the study's clock said.
        question: Id of the question; None for the first experiment, compared with nothing.
        challenger: Index of the experiment that was proposed.
        incumbent: Index of the best one at the time.
        challenger_left: Where the challenger stood.
        answer: The verdict, as challenger and incumbent.
        comment: The person's remark.
        blind: Whether θ and the roles were hidden.
        repeats: Id of the earlier question that it asked again.
        retracted: Whether it teaches nothing any more.
        after: For a further comparison of two known experiments: how many queries were closed.
    """

    seq: int
    at: str
    question: int | None
    challenger: int
    incumbent: int | None
    challenger_left: bool | None
    answer: Answer
    comment: str
    blind: bool
    repeats: int | None = None
    retracted: bool = False
    after: int | None = None


@dataclass(frozen=True, slots=True)
class State:
    """State of a study after its events. Indices count samples from 0.

    Args:
        configuration: As it was created.
        created: When.
        n_max: Experiments wanted in all.
        samples: By index, as they were run; the last may have no answer yet.
        proposed: Index to the θ that was proposed, where another one was run.
        finished: Index to the event whose payload is its experiment.
        failures: Index to the error of a run that raised, while there is no experiment.
        closed: Closed queries that stand; number i has challenger i.
        further: Answers about two experiments that had both been closed before.
        repeats: Answers to repeated questions.
        marks: Index to the marks that the experiment bears.
        notes: When and what.
        open: Id and event of the question on show.
        ended: Why it is over; None while it goes on.
    """

    configuration: Mapping[str, Any]
    created: str
    n_max: int
    samples: tuple[Suggested, ...] = ()
    proposed: Mapping[int, tuple[float, ...]] = field(default_factory=dict)
    finished: Mapping[int, int] = field(default_factory=dict)
    failures: Mapping[int, str] = field(default_factory=dict)
    closed: tuple[Closed, ...] = ()
    further: tuple[Closed, ...] = ()
    repeats: tuple[Closed, ...] = ()
    marks: Mapping[int, frozenset[str]] = field(default_factory=dict)
    notes: tuple[tuple[str, str], ...] = ()
    open: tuple[int, Shown] | None = None
    ended: str | None = None

    @property
    def answers(self) -> tuple[Closed, ...]:
        """All answers in the order given, with those to further and repeated questions."""
        every = (*self.closed[1:], *self.further, *self.repeats)
        return tuple(sorted(every, key=lambda c: c.seq))


def counted_unsafe(state: State) -> frozenset[int]:
    """Return the experiments that count as unsafe because of how they ended, without a mark.

    Only answers that still stand say so.
    """
    return unsafe_indices((*state.closed, *state.further), automatic=True)


def begin(seq: int, at: str, event: Event) -> State:
    """Return the state after the first event.

    Raises:
        StudyError: it is no Created with an integer `n_max`.
    """
    n_max = event.configuration.get("n_max") if isinstance(event, Created) else None
    if not isinstance(event, Created) or type(n_max) is not int or n_max < 1:
        raise StudyError(f"event {seq}: a study begins with its configuration and its n_max")
    return State(MappingProxyType(dict(event.configuration)), at, n_max)


def step(state: State, seq: int, at: str, event: Event) -> State:
    """Return the state after one more event.

    Raises:
        StudyError: the event is impossible in `state`; it names the number of the event.
    """
    match event:
        case Suggested():
            return _suggested(state, seq, event)
        case Finished(index):
            _sample(state, seq, index)
            earlier = event.same_as is None or 0 < event.same_as < seq
            _require(earlier, seq, f"event {event.same_as} is no earlier one")
            failures = {i: e for i, e in state.failures.items() if i != index}
            source = seq if event.same_as is None else event.same_as
            return replace(state, finished={**state.finished, index: source}, failures=failures)
        case Dialed():
            return _dialed(state, seq, event)
        case Replaced():
            return _replaced(state, seq, event)
        case Failed(index, error):
            _sample(state, seq, index)
            return replace(state, failures={**state.failures, index: error})
        case Shown(challenger, incumbent):
            _shown(state, seq, challenger, incumbent)
            return replace(state, open=(seq, event))
        case Answered():
            return _answered(state, seq, at, event)
        case Marked(index, mark, on):
            _sample(state, seq, index)
            _require(mark in MARKS, seq, f"a mark must be one of {MARKS}, got {mark!r}")
            # One mark excludes the other: the last one holds.
            now = frozenset({mark}) if on else state.marks.get(index, frozenset()) - {mark}
            return replace(state, marks={**state.marks, index: now})
        case Retracted(answer):
            return _retracted(state, seq, answer)
        case Undone():
            return _undone(state, seq)
        case Noted(text):
            return replace(state, notes=(*state.notes, (at, text)))
        case Extended(n_max):
            _require(n_max >= len(state.closed), seq, f"n_max {n_max} is below what is answered")
            return replace(state, n_max=n_max)
        case Ended(reason):
            return replace(state, ended=reason, open=None)
        case Reopened():
            return replace(state, ended=None)
        case Respaced():
            return _respaced(state, seq, event)
        case Adjusted(settings):
            return _adjusted(state, seq, settings)
        case Created():
            raise StudyError(f"event {seq}: a study is created once")
    raise StudyError(f"event {seq}: there is no rule for {type(event).__name__}")


def _require(holds: bool, seq: int, otherwise: str) -> None:
    if not holds:
        raise StudyError(f"event {seq} is impossible: {otherwise}")


def _sample(state: State, seq: int, index: int) -> None:
    _require(0 <= index < len(state.samples), seq, f"sample {index} was never proposed")


def _suggested(state: State, seq: int, event: Suggested) -> State:
    due = len(state.closed)
    _require(event.index == due == len(state.samples), seq, f"sample {event.index} is not due")
    _require(len(event.z) == len(event.theta) > 0, seq, "z and theta differ in length")
    # No question is on show then, unless a change of the agent's settings has made it obsolete.
    return replace(state, samples=(*state.samples, event), open=None)


def _dialed(state: State, seq: int, event: Dialed) -> State:
    due = len(state.closed)
    _require(event.index == due == len(state.samples) - 1, seq, f"sample {event.index} is not open")
    was = state.samples[due]
    _require(len(event.z) == len(event.theta) == len(was.z), seq, "z and theta differ in length")
    proposed = {due: was.theta, **state.proposed}  # dialed twice: what was proposed stays
    sample = Suggested(due, event.z, event.theta)
    return replace(state, samples=(*state.samples[:due], sample), proposed=proposed)


def _replaced(state: State, seq: int, event: Replaced) -> State:
    _require(event.index in state.finished, seq, f"there is no experiment of sample {event.index}")
    _require(state.ended is None, seq, "the study is over")
    return replace(
        state,
        closed=tuple(corrected(c, event) for c in state.closed),
        further=tuple(corrected(c, event) for c in state.further),
        repeats=tuple(corrected(c, event) for c in state.repeats),
        marks={i: m for i, m in state.marks.items() if i != event.index},
    )


def _shown(state: State, seq: int, challenger: int, incumbent: int) -> None:
    for index in (challenger, incumbent):
        _require(index in state.finished, seq, f"there is no experiment of sample {index}")
    _require(challenger != incumbent, seq, "an experiment is not compared with itself")


def _answered(state: State, seq: int, at: str, event: Answered) -> State:
    scored = event.question is None and event.incumbent is not None
    first = event.question is None and not scored
    shown = None if state.open is None or state.open[0] != event.question else state.open[1]
    pair = None if shown is None else (shown.challenger, shown.incumbent)
    if first:
        _require(
            event.challenger == 0 == len(state.closed) and event.incumbent is None, seq,
            "only the first experiment is compared with nothing",
        )  # fmt: skip
        _require(0 in state.finished, seq, "there is no experiment of sample 0")
    elif scored:
        for index in (event.challenger, event.incumbent):
            _require(index in state.finished, seq, f"there is no experiment of sample {index}")
    else:
        _require(
            pair == (event.challenger, event.incumbent), seq,
            f"question {event.question} is not on show",
        )  # fmt: skip
    closed = Closed(
        seq, at, event.question, event.challenger, event.incumbent,
        None if shown is None else shown.challenger_left, event.answer, event.comment,
        event.blind, None if shown is None else shown.repeats,
    )  # fmt: skip
    if closed.repeats is not None:
        return replace(state, repeats=(*state.repeats, closed), open=None)
    due = len(state.closed)
    if event.question is not None and event.challenger < due:
        closed = replace(closed, after=due)
        return replace(state, further=(*state.further, closed), open=None)
    _require(event.challenger == due, seq, f"sample {due} is due, not {event.challenger}")
    return replace(state, closed=(*state.closed, closed), open=None)


def _retracted(state: State, seq: int, answer: int) -> State:
    if answer < 0:
        return _retracted_further(state, seq, -answer - 1)
    _require(0 <= answer < len(state.closed), seq, f"there is no answer {answer}")
    _require(not state.closed[answer].retracted, seq, f"answer {answer} is retracted already")
    changed = replace(state.closed[answer], retracted=True)
    closed = (*state.closed[:answer], changed, *state.closed[answer + 1 :])
    return replace(state, closed=closed)


def _retracted_further(state: State, seq: int, k: int) -> State:
    _require(k < len(state.further), seq, f"there is no further answer {k + 1}")
    _require(not state.further[k].retracted, seq, f"further answer {k + 1} is retracted already")
    changed = replace(state.further[k], retracted=True)
    return replace(state, further=(*state.further[:k], changed, *state.further[k + 1 :]))


def _undone(state: State, seq: int) -> State:
    _require(len(state.closed) > 0, seq, "there is no answer to take back")
    kept = len(state.closed)
    was_further = bool(state.further) and state.further[-1].after == kept
    return replace(
        state,
        closed=state.closed if was_further else state.closed[:-1],
        further=state.further[:-1] if was_further else state.further,
        samples=state.samples[:kept],
        finished={i: s for i, s in state.finished.items() if i < kept},
        failures={i: e for i, e in state.failures.items() if i < kept},
        marks={i: m for i, m in state.marks.items() if i < kept},
        proposed={i: theta for i, theta in state.proposed.items() if i < kept},
        open=None,
        ended=None,
    )


def _adjusted(state: State, seq: int, settings: Mapping[str, Any]) -> State:
    agent: Any = state.configuration.get("agent")
    before = agent.get("settings") if isinstance(agent, Mapping) else None
    if not isinstance(before, Mapping):
        raise StudyError(f"event {seq} is impossible: the agent of the study has no settings")
    changed = {**agent, "settings": {**before, **settings}}
    configuration = MappingProxyType({**state.configuration, "agent": changed})
    return replace(state, configuration=configuration)


def _respaced(state: State, seq: int, event: Respaced) -> State:
    due = len(state.closed)
    kept = due + 1 if due in state.finished else due
    expected = {"knobs", "within", "scenario_knobs"}
    _require(set(event.space) == expected, seq, f"its space must have {sorted(expected)}")
    agent = state.configuration.get("agent", {})
    _require(isinstance(agent, Mapping), seq, "the study has no agent")
    configuration = {
        **state.configuration, **event.space, "agent": {**agent, **event.agent}, "respaced": seq,
    }  # fmt: skip
    old, new = space_of(state.configuration), space_of(configuration)
    space_of({"knobs": event.space["scenario_knobs"]})

    def moved(theta: tuple[float, ...]) -> np.ndarray:
        return carried(np.array(theta), old, new, event.added)

    try:
        samples = [
            Suggested(s.index, tuple(new.encode(moved(s.theta)).tolist()), tuple(moved(s.theta)))
            for s in state.samples[:kept]
        ]
    except (KnobError, TypeError, ValueError) as error:
        raise StudyError(f"event {seq} is impossible: {error}") from error
    return replace(
        state,
        configuration=MappingProxyType(configuration),
        samples=tuple(samples),
        failures={i: e for i, e in state.failures.items() if i < kept},
        marks={i: m for i, m in state.marks.items() if i < kept},
        proposed={i: tuple(moved(t)) for i, t in state.proposed.items() if i < kept},
    )
