"""Replay a history into optimizers that own their state.

A strategy is a function of the history. An optimizer that learns step by step is not, so it gets
the history one answer at a time, and is kept as long as the history only grows.
"""

from collections.abc import Callable
from typing import Generic, TypeVar, final

from prefcal_env.preferences.history import History

Session = TypeVar("Session")


@final
class Replay(Generic[Session]):
    """A session that has seen exactly a history: kept if the history continues, else replaced.

    A new session is needed after an undo, a retraction or a restart, and in copies of an agent. It
    sees the stored samples and the current answers.

    Args:
        start: Function that creates an empty session.
        feed: Function that shows a session the last answer of a history; it has seen the others.
    """

    def __init__(
        self, start: Callable[[], Session], feed: Callable[[Session, History], None]
    ) -> None:
        self._start, self._feed = start, feed
        self._seen = History()
        self._session: Session | None = None

    def at(self, history: History) -> Session:
        """Return a session that has seen all answers of `history` and no others."""
        past = self._seen.answered
        if self._session is None or history.until(past) != self._seen:
            self._session, past = self._start(), 0
        session, self._session = self._session, None  # dropped if feeding fails
        for count in range(past + 1, history.answered + 1):
            self._feed(session, history.until(count))
        self._seen, self._session = history.until(history.answered), session
        return session
