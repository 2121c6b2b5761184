"""Implement the ask/tell protocol that every agent follows.

An agent composes one `Session` and brings a proposal strategy: a function of the history alone
(seed and settings are fixed), so nothing else has to be saved.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_agents.history.agent_state import AgentState
from prefcal_agents.space.capacity import capacity
from prefcal_agents.space.start import Start, start_points
from prefcal_agents.support.checks import integer
from prefcal_env.errors import KnobError, ProtocolError, SettingsError
from prefcal_env.knobs.knob import KnobSpace
from prefcal_env.preferences.answer import Answer, Preference, Query, Suggestion
from prefcal_env.preferences.history import History, Sample

from .rematch import rematch

_SAME_PLACE = 1e-6
"""Maximum difference of θ and the θ of z in a saved sample, as a share of a knob's range."""

Propose = Callable[[History], Float[np.ndarray, " n"]]
FollowUp = Callable[[History], tuple[int, int] | None]


def _no_follow_up(history: History) -> None:
    return None


class Session:
    """The mutable part of an agent: its history, and the open query made on demand.

    Sample h is proposed when it is first needed, from the history after answer h - 1. From then
    on it is stored and stays, even if an earlier answer is retracted, since its experiment may
    have run already. Only the incumbent that it is compared with may then change. `undo` reopens
    the last closed query and drops the sample proposed after it.

    Args:
        space: Knobs to tune.
        n_init: Number of samples of the space-filling start, 1 or more.
        n_max: Number of experiments asked for, not below `n_init`.
        propose: Function from the history to the next sample, a point of the cube, shape (n,).
        by_value: Whether scores are told; then no query has an incumbent.
        follow_up: Function from the history to two known samples to compare before the next one is
            proposed, challenger and incumbent; None if there is nothing (more) to ask.
        last: The same function for the time after the last experiment.
        start: Physical θ of the first samples, instead of proposed ones.

    Raises:
        SettingsError: an impossible count, or a θ twice in `start`.
        KnobError: a θ of `start` is outside the space.
    """

    def __init__(
        self,
        space: KnobSpace,
        n_init: int,
        n_max: int,
        propose: Propose,
        *,
        by_value: bool = False,
        follow_up: FollowUp = _no_follow_up,
        last: FollowUp = _no_follow_up,
        start: Start | None = None,
    ) -> None:
        if not isinstance(space, KnobSpace):
            raise SettingsError(f"space must be a KnobSpace, got {space!r}")
        integer("n_init", n_init, low=1)
        integer("n_max", n_max, low=2)
        if n_max < n_init:
            raise SettingsError(f"n_max must not be below n_init, got {n_max} below {n_init}")
        self.space, self.n_init, self._asked_for = space, int(n_init), int(n_max)
        self._propose, self.by_value = propose, by_value
        self._follow_up, self._last = follow_up, last
        self._chosen: tuple[History, int | None] | None = None
        self._thought: tuple[History, tuple[int, int] | None] | None = None
        self._capacity = capacity(space)
        self._start = start_points(space, start, self._asked_for)
        self.history = History()

    @property
    def n_max(self) -> int:
        """Return the number of experiments asked for, or of θ if the space holds fewer."""
        return self._most(self.history)

    def _most(self, history: History) -> int:
        most = self._capacity
        if most >= self._asked_for:
            return self._asked_for
        # θ that ran count too if they are no longer searched.
        most += sum(not self.space.searches(np.array(s.theta)) for s in history.samples)
        return int(min(self._asked_for, most))

    @property
    def done(self) -> bool:
        """Return whether all experiments are answered and it is clear which one is the best."""
        return self._all_answered and self._follow_up_pair() is None

    @property
    def _all_answered(self) -> bool:
        return self.history.answered >= self.n_max

    @property
    def best(self) -> Float[np.ndarray, " n"]:
        """Return θ of the incumbent, physical, shape (n,)."""
        if self.best_index is None:
            raise ProtocolError("there is no best θ before the first answer")
        return self._theta(self.best_index)

    @property
    def best_index(self) -> int | None:
        """Return the index of the best sample so far; None before the first answer."""
        history = self.history
        if self._chosen is None or self._chosen[0] != history:
            self._chosen = (history, history.incumbent)
        return self._chosen[1]

    def ask(self) -> Query:
        """Return the open query, which stays the same until an answer is told or taken back."""
        if self.done:
            why = f"all {self.n_max} experiments are answered"
            if self.n_max < self._asked_for:
                why = f"every one of the {self.n_max} θ of the space has been tried"
            raise ProtocolError(f"there is no open query: {why}")
        pair = self._follow_up_pair()
        if pair is not None:
            first, second = (Suggestion(index, self._theta(index)) for index in pair)
            return Query(first, second, further=True)
        self.settle()
        challenger, incumbent = self.history.answered, self._rival
        return Query(
            Suggestion(challenger, self._theta(challenger)),
            None if incumbent is None else Suggestion(incumbent, self._theta(incumbent)),
        )

    def _follow_up_pair(self) -> tuple[int, int] | None:
        """Return the known samples to compare now; None once a new one is stored.

        Open questions about the best sample come first, also after the last experiment.
        """
        history = self.history
        if self.by_value or history.pending is not None or not history.answered:
            return None
        if self._thought is None or self._thought[0] != history:
            pair = rematch(history)
            if pair is None:
                pair = self._last(history) if self._all_answered else self._follow_up(history)
            self._thought = (history, pair)
        return self._thought[1]

    @property
    def _rival(self) -> int | None:
        return None if self.by_value else self.best_index

    def tell(self, query: Query, answer: Answer | Preference | float | None) -> None:
        """Close `query` by an answer: a plain -1, 0, 1 or None, or a score if scores are told."""
        given = Answer.scored(answer) if self.by_value else Answer.of(answer)  # type: ignore[arg-type]
        if self.done:
            raise ProtocolError(f"told {query}, but all {self.n_max} experiments are answered")
        if query != self.ask():
            raise ProtocolError(f"told {query}, but the open query is {self.ask()}")
        pair = self._follow_up_pair()
        if pair is None:
            self.history = self.history.told(given, self._rival)
        else:
            self.history = self.history.told_follow_up(given, *pair)

    def undo(self) -> None:
        """Take the last answer back."""
        self.history = self.history.undone()

    def retract(self, index: int, *, further: bool = False) -> None:
        """Forget answer `index`; the sample of the open query was fixed before."""
        changed = self.history.retracted(index, follow_up=further)
        if not self.done:
            self.settle()
            changed = self.history.retracted(index, follow_up=further)
        self.history = changed

    def settle(self) -> None:
        """Store the sample of the open query, unless it is stored or none is needed now."""
        if self.done or self._follow_up_pair() is not None:
            return
        if self.history.pending is None:
            self.history = self.history.with_pending(Sample.of(self.space, self._next()))

    def _next(self) -> Float[np.ndarray, " n"]:
        """Return a given θ unchanged, a proposed one rounded to values that can be dialed in."""
        if self.history.answered < len(self._start):
            return np.array(self._start[self.history.answered])
        return self.space.snap(self._propose(self.history))

    def samples(self) -> Float[np.ndarray, "N n"]:
        """Return θ of all closed queries, physical, in the order tried, shape (N, n)."""
        tried = [sample.theta for sample in self.history.samples[: self.history.answered]]
        return np.array(tried, dtype=float).reshape(-1, len(self.space))

    def _theta(self, index: int) -> Float[np.ndarray, " n"]:
        return np.array(self.history.samples[index].theta)

    def state(
        self, agent: str, version: int, seed: int, settings: tuple[tuple[str, Any], ...] = ()
    ) -> AgentState:
        """Return what has to be saved of the agent called `agent`."""
        return AgentState(
            agent, version, self.n_init, self._asked_for, seed, self.history, settings, self._start
        )

    def load(self, history: History, start: tuple[tuple[float, ...], ...] = ()) -> None:
        """Take over `history`, and the points of the cube to begin with.

        Raises:
            SettingsError: they do not fit the space or the counts.
        """
        history = history.scores_alone().bare() if self.by_value else history.bare()
        self._check(history)
        try:
            thetas = [self.space.decode(np.array(z)) for z in start]
        except KnobError as error:
            raise SettingsError(f"the start of a state: {error}") from error
        self._start = start_points(self.space, thetas, self._asked_for)
        self.history = history

    def follow(self, other: "Session") -> None:
        """Take over the samples and answers of `other`, of an agent in the same space."""
        self._start, self.history = other._start, other.history

    def _check(self, history: History) -> None:
        answered = history.answered
        for h, comparison in enumerate(history.comparisons):
            rival = comparison.incumbent
            alone = h == 0 or self.by_value
            if (rival is None) != alone or (rival is not None and not 0 <= rival < h):
                raise SettingsError(f"answer {h} of a state cannot be against sample {rival}")
        for c in history.follow_ups:
            pair = {c.challenger, c.incumbent}
            known = c.after is not None and 0 < c.after <= answered and not self.by_value
            if not known or len(pair) < 2 or any(i is None or not 0 <= i < c.after for i in pair):  # type: ignore[operator]
                raise SettingsError(f"a follow-up answer of a state cannot be {c}")
        for index, sample in enumerate(history.samples):
            self._check_sample(index, sample)
        stored, most = len(history.samples), self._most(history)
        if not answered <= stored <= answered + 1 or stored > most:
            raise SettingsError(
                f"a state of up to {most} experiments cannot hold {stored} samples and "
                f"{answered} answers"
            )

    def _check_sample(self, index: int, sample: Sample) -> None:
        try:
            theta = self.space.check_allowed(np.array(sample.theta))
            there = self.space.decode(np.array(sample.z))
        except KnobError as error:
            raise SettingsError(f"sample {index} of a state: {error}") from error
        span = np.array([knob.high - knob.low for knob in self.space])
        if np.any(np.abs(there - theta) > _SAME_PLACE * span):
            raise SettingsError(
                f"sample {index} of a state: z and theta are not the same place, got {sample}"
            )
