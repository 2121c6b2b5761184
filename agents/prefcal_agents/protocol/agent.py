"""Offer the public methods of an agent, each passed on to its `Session`."""

from typing import Any, Protocol

import numpy as np
from jaxtyping import Float

from prefcal_agents.advice.stopping import Advice, advise
from prefcal_env.knobs.knob import KnobSpace
from prefcal_env.preferences.answer import Answer, Preference, Query

from .session import Session
from .stored import Stored


class AgentBase(Protocol):
    """Give an agent with `_session` everything of the protocol except `tell`."""

    _session: Session

    @property
    def space(self) -> KnobSpace:
        """Return the knobs that θ consists of."""
        return self._session.space

    @property
    def n_init(self) -> int:
        """Return the number of samples of the space-filling start."""
        return self._session.n_init

    @property
    def n_max(self) -> int:
        """Return the number of experiments; fewer than asked for if the space holds fewer θ."""
        return self._session.n_max

    @property
    def by_value(self) -> bool:
        """Return whether the agent is told scores, not preferences."""
        return self._session.by_value

    @property
    def done(self) -> bool:
        """Return whether all experiments are answered."""
        return self._session.done

    @property
    def best(self) -> Float[np.ndarray, " n"]:
        """Return θ of the best sample, shape (n,). Raises ProtocolError before any answer."""
        return self._session.best

    @property
    def best_index(self) -> int | None:
        """Return the index of the best sample; None before any answer."""
        return self._session.best_index

    @property
    def samples(self) -> Float[np.ndarray, "N n"]:
        """Return θ of all answered queries, physical, in the order tried, shape (N, n)."""
        return self._session.samples()

    @property
    def advice(self) -> Advice | None:
        """Return the expected gain of ten more experiments; None while it is unknown."""
        return advise(self._session.history)

    def ask(self) -> Query:
        """Return the open query, the same until it is told. Raises ProtocolError when done."""
        return self._session.ask()

    def undo(self) -> None:
        """Take the last answer back and open its query again. Raises ProtocolError if none."""
        self._session.undo()

    def retract(self, index: int, *, further: bool = False) -> None:
        """Forget what answer `index` (from 0) taught; all samples stay, including the open one.

        Answers to follow-up questions (`further`) are numbered separately.

        Raises:
            ProtocolError: there is no such answer, or it is retracted already.
        """
        self._session.retract(index, further=further)


class PreferenceBased(AgentBase, Protocol):
    """An agent that learns from preferences."""

    def tell(self, query: Query, answer: Answer | Preference | int | None) -> None:
        """Close `query`.

        Raises:
            ProtocolError: it is not the open one.
            PreferenceError: `answer` is none of -1, 0, 1, None (can't tell) and an Answer.
        """
        self._session.tell(query, answer)


class ValueBased(AgentBase, Protocol):
    """An agent that sees the score of every experiment: its queries have no incumbent."""

    def tell(self, query: Query, value: Answer | float | None) -> None:
        """Close `query` with the score of its experiment, lower is better; None if it has none.

        Raises:
            ProtocolError: it is not the open one.
            PreferenceError: `value` is not finite, or holds a preference.
        """
        self._session.tell(query, value)


class AnyAgent(Stored, AgentBase, Protocol):
    """What every agent of the registry offers, whatever it is told."""

    def tell(self, query: Query, answer: Any, /) -> None:
        """Close `query` by a preference or a score."""
