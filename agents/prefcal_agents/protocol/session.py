"""Whose turn it is: the ask/tell protocol that every preference-based agent follows.

An agent composes one `Session` and brings a proposal strategy: a function of the history alone
(seed and settings are fixed), so that nothing else needs saving.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_agents.history.agent_state import AgentState
from prefcal_agents.history.history import History
from prefcal_agents.space.capacity import capacity
from prefcal_agents.space.start import Start, start_points
from prefcal_agents.support.checks import integer
from prefcal_env.errors import KnobError, ProtocolError, SettingsError
from prefcal_env.knobs.knob import KnobSpace
from prefcal_env.preferences.answer import Answer, Preference, Query, Suggestion

from .rematch import rematch

Propose = Callable[[History], Float[np.ndarray, " n"]]
Further = Callable[[History], tuple[int, int] | None]


def _nothing_further(history: History) -> None:
    return None


class Session:
    """The mutable part of an agent: its history, and the open query made on demand.

    Sample h is proposed from the history as answer h - 1 left it, when it is first needed; from
    then on it is stored and stays, also when an earlier answer is retracted (its experiment may
    have run already). Only the incumbent that it meets may then change. `undo` reopens the
    last closed query and drops the sample proposed after it.

    Args:
        space: The knobs.
        n_init: Samples of the space-filling start, 1 or more.
        n_max: Experiments asked for, not below `n_init`.
        propose: Cube point, shape (n,), of the next sample, from the history.
        by_value: Whether scores are told: then no query has an incumbent.
        further: Two known samples to compare before the next one is proposed, from the history:
            challenger and incumbent; None if there is nothing (more) to ask.
        last: The same after the last experiment.
        start: Physical θ that are the first samples, in place of proposed ones.

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
        further: Further = _nothing_further,
        last: Further = _nothing_further,
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
        self._further, self._last = further, last
        self._chosen: tuple[History, int | None] | None = None
        self._thought: tuple[History, tuple[int, int] | None] | None = None
        self._capacity = capacity(space)
        self._start = start_points(space, start, self._asked_for)
        self.history = History()

    @property
    def n_max(self) -> int:
        """Experiments until the end: as asked for, or all θ of a space that holds fewer."""
        return self._most(self.history)

    def _most(self, history: History) -> int:
        most = self._capacity
        if np.isfinite(most):
            # θ that are no longer searched count too, if they have run.
            thetas = (self.space.decode(np.array(z)) for z in history.samples)
            most += sum(not self.space.searches(theta) for theta in thetas)
        return int(min(self._asked_for, most))

    @property
    def done(self) -> bool:
        """Whether all experiments are answered, and it is clear which one is the best."""
        return self._all_answered and self._further_pair() is None

    @property
    def _all_answered(self) -> bool:
        return self.history.answered >= self.n_max

    @property
    def best(self) -> Float[np.ndarray, " n"]:
        """θ of the incumbent, physical, shape (n,)."""
        if self.best_index is None:
            raise ProtocolError("there is no best θ before the first answer")
        return self._theta(self.best_index)

    @property
    def best_index(self) -> int | None:
        """Number of the sample that is the best so far; None before the first answer."""
        history = self.history
        if self._chosen is None or self._chosen[0] != history:
            self._chosen = (history, history.incumbent)
        return self._chosen[1]

    def ask(self) -> Query:
        """Return the open query, which stays the same until something is told or taken back."""
        if self.done:
            why = f"all {self.n_max} experiments are answered"
            if self.n_max < self._asked_for:
                why = f"every one of the {self.n_max} θ of the space has been tried"
            raise ProtocolError(f"there is no open query: {why}")
        pair = self._further_pair()
        if pair is not None:
            first, second = (Suggestion(index, self._theta(index)) for index in pair)
            return Query(first, second, further=True)
        self.settle()
        challenger, incumbent = self.history.answered, self._rival
        return Query(
            Suggestion(challenger, self._theta(challenger)),
            None if incumbent is None else Suggestion(incumbent, self._theta(incumbent)),
        )

    def _further_pair(self) -> tuple[int, int] | None:
        """The known samples that are to be compared now; nothing once a new one is stored.

        What the record leaves open about the best comes first, also after the last experiment.
        """
        history = self.history
        if self.by_value or history.pending is not None or not history.answered:
            return None
        if self._thought is None or self._thought[0] != history:
            pair = rematch(history)
            if pair is None:
                pair = self._last(history) if self._all_answered else self._further(history)
            self._thought = (history, pair)
        return self._thought[1]

    @property
    def _rival(self) -> int | None:
        return None if self.by_value else self.best_index

    def tell(self, query: Query, answer: Answer | Preference | float | None) -> None:
        """Close `query` by an answer: a bare -1, 0, 1 or None, or a score where those are told."""
        given = Answer.scored(answer) if self.by_value else Answer.of(answer)  # type: ignore[arg-type]
        if self.done:
            raise ProtocolError(f"told {query}, but all {self.n_max} experiments are answered")
        if query != self.ask():
            raise ProtocolError(f"told {query}, but the open query is {self.ask()}")
        pair = self._further_pair()
        if pair is None:
            self.history = self.history.told(given, self._rival)
        else:
            self.history = self.history.told_further(given, *pair)

    def undo(self) -> None:
        """Take the last answer back."""
        self.history = self.history.undone()

    def retract(self, index: int, *, further: bool = False) -> None:
        """Forget answer `index`; the sample of the open query was fixed before."""
        changed = self.history.retracted(index, further=further)
        if not self.done:
            self.settle()
            changed = self.history.retracted(index, further=further)
        self.history = changed

    def settle(self) -> None:
        """Store the sample of the open query, unless it is stored, or none is wanted now."""
        if self.done or self._further_pair() is not None:
            return
        if self.history.pending is None:
            self.history = self.history.with_pending(self._next())

    def _next(self) -> Float[np.ndarray, " n"]:
        """A given θ as it is; a proposed one rounded to what can be dialed in."""
        if self.history.answered < len(self._start):
            return np.array(self._start[self.history.answered])
        return self.space.snap(self._propose(self.history))

    def samples(self) -> Float[np.ndarray, "N n"]:
        """θ of all closed queries, physical, in the order tried, shape (N, n)."""
        return np.array([self._theta(i) for i in range(self.history.answered)]).reshape(
            -1, len(self.space)
        )

    def _theta(self, index: int) -> Float[np.ndarray, " n"]:
        return self.space.decode(np.array(self.history.samples[index]))

    def state(
        self, agent: str, version: int, seed: int, settings: tuple[tuple[str, Any], ...] = ()
    ) -> AgentState:
        """What has to be saved of the agent called `agent`."""
        return AgentState(
            agent, version, self.n_init, self._asked_for, seed, self.history, settings, self._start
        )

    def load(self, history: History, start: tuple[tuple[float, ...], ...] = ()) -> None:
        """Take `history` over, and the points of the cube that it is to begin with.

        Raises:
            SettingsError: it does not fit the space or the counts.
        """
        answered = history.answered
        for h, comparison in enumerate(history.comparisons):
            rival = comparison.incumbent
            alone = h == 0 or self.by_value
            if (rival is None) != alone or (rival is not None and not 0 <= rival < h):
                raise SettingsError(f"answer {h} of a state cannot be against sample {rival}")
        for c in history.further:
            pair = {c.challenger, c.incumbent}
            known = c.after is not None and 0 < c.after <= answered and not self.by_value
            if not known or len(pair) < 2 or any(i is None or not 0 <= i < c.after for i in pair):  # type: ignore[operator]
                raise SettingsError(f"a further answer of a state cannot be {c}")
        for index, z in enumerate(history.samples):
            try:
                self.space.check_allowed(self.space.decode(np.array(z)))
            except KnobError as error:
                raise SettingsError(f"sample {index} of a state: {error}") from error
        stored, most = len(history.samples), self._most(history)
        if not answered <= stored <= answered + 1 or stored > most:
            raise SettingsError(
                f"a state of up to {most} experiments cannot hold {stored} samples and "
                f"{answered} answers"
            )
        try:
            thetas = [self.space.decode(np.array(z)) for z in start]
        except KnobError as error:
            raise SettingsError(f"the start of a state: {error}") from error
        self._start = start_points(self.space, thetas, self._asked_for)
        self.history = history
