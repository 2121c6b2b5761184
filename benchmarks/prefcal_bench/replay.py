"""Replay a history into optimizers that own their state.

A strategy is a function of the history. An optimizer that learns step by step is not, so it gets
the history one answer at a time, and is kept as long as the history only grows.
"""

from collections.abc import Callable
from threading import local
from typing import Generic, TypeVar, final

from prefcal_env.preferences.history import History

Session = TypeVar("Session")


@final
class Replay(Generic[Session]):
    """A session that has seen exactly a history: kept if the history continues, else replaced.

    A new session is needed after an undo, a retraction or a restart, in each thread, and whenever
    copies of an agent take turns. It sees the stored samples and the current answers.

    Args:
        start: Function that creates an empty session.
        feed: Function that shows a session the last answer of a history; it has seen the others.
    """

    def __init__(self, start: Callable[[], Session], feed: Callable[[Session, History], None]) -> None:
        self._start, self._feed = start, feed
        self._own = local()  # an optimizer serves one thread

    def at(self, history: History) -> Session:
        """Return a session that has seen all answers of `history` and no others."""
        seen, session = getattr(self._own, "kept", None) or (History(), None)
        if session is None or history.until(seen.answered) != seen:
            seen, session = History(), self._start()
        self._own.kept = None  # dropped if feeding fails
        for count in range(seen.answered + 1, history.answered + 1):
            self._feed(session, history.until(count))
        self._own.kept = (history.until(history.answered), session)
        found: Session = session
        return found
