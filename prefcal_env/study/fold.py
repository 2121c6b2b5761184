"""Compute the state of a study from its events, one by one, without side effects."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any

import numpy as np

from prefcal_env.errors import KnobError, ProtocolError, StudyError
from prefcal_env.knobs.change import carried
from prefcal_env.preferences.history import Comparison, History, Sample
from prefcal_env.preferences.kpis import Outcome

from . import events
from .spaces import space_of


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
    open: tuple[int, events.Shown] | None = None
    ended: str | None = None
    reopened: bool = False

    @property
    def answers(self) -> tuple[Comparison, ...]:
        """Return all answers about two experiments in order, including repeated questions."""
        history = self.history
        every = (*history.comparisons[1:], *history.follow_ups, *history.repeats)
        return tuple(sorted(every, key=lambda c: c.seq))


_KNOWN = ("finished", "failures", "marks", "proposed")
"""Fields of `State` with what is known about samples, by index."""


def begin(seq: int, at: str, event: events.Event) -> State:
    """Return the state after the first event.

    Raises:
        StudyError: If it is not a Created with an integer `n_max`.
    """
    n_max = event.configuration.get("n_max") if isinstance(event, events.Created) else None
    if not isinstance(event, events.Created) or type(n_max) is not int or n_max < 1:
        raise StudyError(f"event {seq}: a study begins with its configuration and its n_max")
    return State(MappingProxyType(dict(event.configuration)), at, n_max)


def step(state: State, seq: int, at: str, event: events.Event) -> State:
    """Return the state after one more event.

    Raises:
        StudyError: If the event is impossible in `state`; the error names its number.
    """
    rule = _RULES.get(type(event))
    if rule is None:
        raise StudyError(f"event {seq}: there is no rule for {type(event).__name__}")
    return rule(state, seq, at, event)


def _require(holds: bool, seq: int, otherwise: str) -> None:
    if not holds:
        raise StudyError(f"event {seq} is impossible: {otherwise}")


def _sample(state: State, seq: int, index: int) -> None:
    _require(0 <= index < len(state.history.samples), seq, f"sample {index} was never proposed")


def _suggested(state: State, seq: int, _at: str, event: events.Suggested) -> State:
    history, is_due = state.history, event.index == len(state.history.samples)
    _require(is_due, seq, f"sample {event.index} is not due")
    _require(len(event.z) == len(event.theta) > 0, seq, "z and theta differ in length")
    # No question is open here, except one that changed settings have made obsolete.
    history = history.with_another(Sample(event.z, event.theta))
    return replace(state, history=history, open=None)


def _taken(state: State, seq: int, _at: str, event: events.Taken) -> State:
    try:
        order = state.history.taken(event.index)
    except ProtocolError as error:
        raise StudyError(f"event {seq} is impossible: {error}") from error
    return replace(_arranged(state, order), open=None)


def _led(state: State, seq: int, _at: str, event: events.Led) -> State:
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


def _finished(state: State, seq: int, _at: str, event: events.Finished) -> State:
    _sample(state, seq, event.index)
    earlier = event.same_as is None or 0 < event.same_as < seq
    _require(earlier, seq, f"event {event.same_as} is no earlier one")
    failures = {i: e for i, e in state.failures.items() if i != event.index}
    source = seq if event.same_as is None else event.same_as
    return replace(state, finished={**state.finished, event.index: source}, failures=failures)


def _failed(state: State, seq: int, _at: str, event: events.Failed) -> State:
    _sample(state, seq, event.index)
    return replace(state, failures={**state.failures, event.index: event.error})


def _dialed(state: State, seq: int, _at: str, event: events.Dialed) -> State:
    due, was = state.history.answered, state.history.pending
    if was is None or event.index != due:
        raise StudyError(f"event {seq} is impossible: sample {event.index} is not open")
    _require(len(event.z) == len(event.theta) == len(was.z), seq, "z and theta differ in length")
    proposed = {due: was.theta, **state.proposed}  # dialed twice: keep the proposed θ
    history = state.history.with_pending(Sample(event.z, event.theta))
    return replace(state, history=history, proposed=proposed)


def _requested(state: State, seq: int, _at: str, event: events.Requested) -> State:
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


def _replaced(state: State, seq: int, _at: str, event: events.Replaced) -> State:
    _require(event.index in state.finished, seq, f"there is no experiment of sample {event.index}")
    _require(state.ended is None, seq, "the study is over")
    outcome = Outcome.from_dict(event.outcome) if event.outcome else None
    return replace(
        state,
        history=state.history.corrected(event.index, outcome, unsafe=event.unsafe),
        marks={i: m for i, m in state.marks.items() if i != event.index},
    )


def _shown(state: State, seq: int, _at: str, event: events.Shown) -> State:
    for index in (event.challenger, event.incumbent):
        _require(index in state.finished, seq, f"there is no experiment of sample {index}")
    apart = event.challenger != event.incumbent
    _require(apart, seq, "an experiment is not compared with itself")
    return replace(state, open=(seq, event))


def _marked(state: State, seq: int, _at: str, event: events.Marked) -> State:
    index, mark = event.index, event.mark
    _sample(state, seq, index)
    _require(mark in events.MARKS, seq, f"a mark must be one of {events.MARKS}, got {mark!r}")
    # One mark excludes the other: the last one holds.
    now = frozenset({mark}) if event.on else state.marks.get(index, frozenset()) - {mark}
    return replace(state, marks={**state.marks, index: now})


def _answered(state: State, seq: int, at: str, event: events.Answered) -> State:
    scored = event.question is None and event.incumbent is not None
    first = event.question is None and not scored
    shown = None if state.open is None or state.open[0] != event.question else state.open[1]
    pair = None if shown is None else (shown.challenger, shown.incumbent)
    if first:
        _require(
            event.challenger == 0 == state.history.answered and event.incumbent is None,
            seq,
            "only the first experiment is compared with nothing",
        )
        _require(0 in state.finished, seq, "there is no experiment of sample 0")
    elif scored:
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


def _retracted(state: State, seq: int, _at: str, event: events.Retracted) -> State:
    answer = event.answer
    try:
        if answer < 0:
            history = state.history.retracted(-answer - 1, follow_up=True)
        else:
            history = state.history.retracted(answer)
    except ProtocolError as error:
        raise StudyError(f"event {seq} is impossible: {error}") from error
    return replace(state, history=history)


def _undone(state: State, seq: int, _at: str, _event: events.Undone) -> State:
    _require(state.history.answered > 0, seq, "there is no answer to undo")
    kept = _arranged(state, state.history.undoing())
    return replace(kept, history=state.history.undone(), open=None, ended=None)


def _noted(state: State, _seq: int, at: str, event: events.Noted) -> State:
    return replace(state, notes=(*state.notes, (at, event.text)))


def _extended(state: State, seq: int, _at: str, event: events.Extended) -> State:
    answered = state.history.answered
    _require(event.n_max >= answered, seq, f"n_max {event.n_max} is below what is answered")
    return replace(state, n_max=event.n_max)


def _ended(state: State, _seq: int, _at: str, event: events.Ended) -> State:
    return replace(state, ended=event.reason, open=None)


def _reopened(state: State, _seq: int, _at: str, _event: events.Reopened) -> State:
    return replace(state, ended=None, reopened=True)


def _created(_state: State, seq: int, _at: str, _event: events.Created) -> State:
    raise StudyError(f"event {seq}: a study is created once")


def _adjusted(state: State, seq: int, _at: str, event: events.Adjusted) -> State:
    agent: Any = state.configuration.get("agent")
    before = agent.get("settings") if isinstance(agent, Mapping) else None
    if not isinstance(before, Mapping):
        raise StudyError(f"event {seq} is impossible: the agent of the study has no settings")
    changed = {**agent, "settings": {**before, **event.settings}}
    configuration = MappingProxyType({**state.configuration, "agent": changed})
    return replace(state, configuration=configuration)


def _respaced(state: State, seq: int, _at: str, event: events.Respaced) -> State:
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
            i: tuple(carried(np.array(theta), old, new, event.added).tolist())
            for i, theta in kept.proposed.items()
        }
    except (KnobError, TypeError, ValueError) as error:
        raise StudyError(f"event {seq} is impossible: {error}") from error
    return replace(kept, configuration=MappingProxyType(configuration), history=history, proposed=proposed)


_RULES: Mapping[type[events.Event], Callable[[State, int, str, Any], State]] = {
    events.Created: _created,
    events.Suggested: _suggested,
    events.Taken: _taken,
    events.Led: _led,
    events.Dialed: _dialed,
    events.Requested: _requested,
    events.Finished: _finished,
    events.Replaced: _replaced,
    events.Failed: _failed,
    events.Shown: _shown,
    events.Answered: _answered,
    events.Marked: _marked,
    events.Retracted: _retracted,
    events.Undone: _undone,
    events.Noted: _noted,
    events.Extended: _extended,
    events.Ended: _ended,
    events.Reopened: _reopened,
    events.Respaced: _respaced,
    events.Adjusted: _adjusted,
}
"""Rule of each event: state, number, time and event to the next state."""
