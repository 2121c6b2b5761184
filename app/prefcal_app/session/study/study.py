"""Say what a study needs next: a function of its agent and its record, without input or output."""

from dataclasses import dataclass

import numpy as np

from prefcal_agents.protocol.agent import Strategy
from prefcal_env.preferences.answer import Query
from prefcal_env.preferences.history import Comparison, History
from prefcal_env.preferences.runs import first_ready
from prefcal_env.study import Ended, Event, Led, Shown, State, Suggested, Taken

PERSON = "human"
"""Who answers, in the configuration of a study."""
ENOUGH = "little is left to gain"
"""Why a study ends before its last question."""
_SIDES, _REPEATS = 11, 12
"""Streams of the study's seed; agents use other ones."""


@dataclass(frozen=True, slots=True)
class Think:
    """Let the agent choose the next query, which takes simulations."""


@dataclass(frozen=True, slots=True)
class Write:
    """Save an event that follows from the record."""

    event: Event


@dataclass(frozen=True, slots=True)
class Settle:
    """Close the query of experiment `index`, about which nobody is asked."""

    index: int


@dataclass(frozen=True, slots=True)
class Wait:
    """Run the pending samples that have no experiment."""


@dataclass(frozen=True, slots=True)
class Ask:
    """Ask about two experiments."""

    shown: Shown


@dataclass(frozen=True, slots=True)
class Over:
    """Do nothing: the study has ended."""


Todo = Think | Write | Settle | Wait | Ask | Over


@dataclass(frozen=True, slots=True)
class Study:
    """A study at one moment. Whoever drives it saves each event, and asks again what is to do.

    Args:
        strategy: What the agent asks after a record.
        history: Record as the agent goes by it, see `Agent.recorded`.
        state: State after all events, see `prefcal_env.study.fold`.
        at_once: Number of experiments that may be pending at the same time.
        simulates: Whether choosing a query may take simulations.
    """

    strategy: Strategy
    history: History
    state: State
    at_once: int = 1
    simulates: bool = False

    @property
    def _may_stop(self) -> bool:
        """Return whether a person answers, who did not go on after an end, and sees or wants no question.

        Who asks for a θ, or to be asked again, wants the study to go on.
        """
        state, history = self.state, self.state.history
        person = state.configuration.get("options", {}).get("calibrator") == PERSON
        repeated = bool(history.repeats) and state.answers[-1] is history.repeats[-1]
        wants = repeated or any(index >= history.answered for index in state.requested)
        return person and not (wants or state.open or state.reopened)

    @property
    def seed(self) -> int:
        """Return the seed of the study."""
        return int(self.state.configuration["seed"])

    @property
    def best(self) -> int | None:
        """Return the index of the agent's best experiment so far; None before the first."""
        return self.state.history.incumbent

    @property
    def pending(self) -> Suggested | None:
        """Return the sample that has no answer yet; None until it is proposed."""
        sample, index = self.state.history.pending, self.state.history.answered
        return None if sample is None else Suggested(index, sample.z, sample.theta)

    @property
    def unfinished(self) -> tuple[Suggested, ...]:
        """Return all samples that have no experiment yet, in the order proposed."""
        samples = enumerate(self.state.history.samples)
        return tuple(Suggested(i, s.z, s.theta) for i, s in samples if i not in self.state.finished)

    @property
    def must_think(self) -> bool:
        """Return whether choosing the next query may take simulations, so no lock may be held."""
        return self.simulates and self.history.pending is None and not self.strategy.knows(self.history)

    def todo(self, *, thought: bool = False) -> Todo:
        """Return what is to do now.

        Args:
            thought: Whether the agent has thought about this record, to which only events were
                added that follow from it.
        """
        strategy, samples = self.strategy, self.state.history.samples
        if self.state.ended:
            return Over()
        if self.must_think and not thought:
            return Think()
        leader = strategy.leader(self.history)
        if leader is not None and leader != self.best:
            return Write(Led(leader))
        if strategy.is_over(self.history):
            return Write(Ended("all compared"))
        opened, queries = strategy.open(self.history, self.at_once)
        if len(opened.samples) > len(samples):
            index = len(samples)
            return Write(Suggested(index, opened.samples[index].z, opened.samples[index].theta))
        if self._may_stop and strategy.has_enough(self.history):
            return Write(Ended(ENOUGH))
        # A query about two known experiments comes first, then the experiment that ended first.
        ready = first_ready(queries, lambda side: self.state.finished.get(side.index))
        return Wait() if ready is None else self._about(ready)

    def _about(self, ready: Query) -> Todo:
        """Return what is to do about a query whose experiments are known."""
        new, old = ready.challenger.index, ready.incumbent
        if not ready.further and new != self.state.history.answered:
            return Write(Taken(new))  # it gets the number of the next one to be answered
        if old is None:
            return Settle(new)
        left = challenger_left(self.seed, new, old.index if ready.further else None)
        return Ask(Shown(new, old.index, left))

    @property
    def is_overtaken(self) -> bool:
        """Return whether the agent would now ask another question than the one shown, if any.

        A retraction, a changed setting or a newer algorithm can change the agent's question, and
        after a crash the old one is still shown: an answer to it would be about the wrong pair.
        """
        if self.state.open is None:
            return True
        _, shown = self.state.open
        if shown.repeats is not None:
            return False
        if shown.challenger < self.state.history.answered:
            if self.must_think:
                return True  # until it is known, see `thinking.think`
            over = self.strategy.is_over(self.history)
            asked = None if over else self.strategy.open(self.history)[1][0]
            return asked is None or _pair(asked) != (shown.challenger, shown.incumbent)
        return shown.incumbent != self.best


def _pair(query: Query) -> tuple[int, int | None]:
    """Return the indices of the challenger and the incumbent."""
    return query.challenger.index, None if query.incumbent is None else query.incumbent.index


def challenger_left(seed: int, challenger: int, further: int | None = None) -> bool:
    """Return whether the challenger is on the left: half of the time, reproducibly.

    `further` is the other experiment of a follow-up comparison.
    """
    pair = [challenger] if further is None else [challenger, further]
    return bool(np.random.default_rng([seed, *pair, _SIDES]).random() < 0.5)


def to_repeat(state: State, seed: int) -> Comparison | None:
    """Return an earlier question with a verdict that has not been repeated yet, or None."""
    done = {c.repeats for c in state.history.repeats}
    left = [
        c
        for c in state.history.counting
        if c.question is not None
        and c.question not in done
        and not c.retracted
        and c.answer.preference is not None
    ]
    # Not the very last one, which people remember, unless there is no other.
    left = left[:-1] if len(left) > 1 and left[-1] is state.history.comparisons[-1] else left
    if not left:
        return None
    rng = np.random.default_rng([seed, len(state.history.repeats), _REPEATS])
    return left[int(rng.integers(len(left)))]
