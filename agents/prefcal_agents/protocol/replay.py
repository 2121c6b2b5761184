"""A live session as a cache, for optimisers that own their state.

A strategy is a function of the history. An optimiser that learns a step at a time is not; so it is
fed the history one answer after another, and kept while the history only grows.
"""

from collections.abc import Callable
from typing import Generic, TypeVar, final

from prefcal_agents.history.history import History

Session = TypeVar("Session")


@final
class Replay(Generic[Session]):
    """The session that has seen exactly a history: kept where that continues, else made afresh.

    Fresh ones are needed after an undo, a retraction, a restart, and in twins. They see the
    stored samples and the answers as they stand now.

    Args:
        start: Makes a session that has seen nothing.
        feed: Lets a session see the last answer of a history, having seen the ones before.
    """

    def __init__(
        self, start: Callable[[], Session], feed: Callable[[Session, History], None]
    ) -> None:
        self._start, self._feed = start, feed
        self._seen = History()
        self._session: Session | None = None

    def at(self, history: History) -> Session:
        """A session that has seen all answers of `history`, and no more."""
        past = self._seen.answered
        if self._session is None or history.until(past) != self._seen:
            self._session, past = self._start(), 0
        session, self._session = self._session, None  # lost, should feeding fail
        for count in range(past + 1, history.answered + 1):
            self._feed(session, history.until(count))
        self._seen, self._session = history.until(history.answered), session
        return session
