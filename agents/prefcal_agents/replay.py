"""A live session as a cache, for optimisers that own their state.

A strategy is a function of the ledger. An optimiser that learns a step at a time is not; so it is
fed the ledger one answer after another, and kept while the ledger only grows.
"""

from collections.abc import Callable
from typing import Generic, TypeVar, final

from .ledger import Ledger

Session = TypeVar("Session")


@final
class Replay(Generic[Session]):
    """The session that has seen exactly a ledger: kept where that continues, else made afresh.

    Fresh ones are needed after an undo, a retraction, a restart, and in twins. They see the
    stored samples and the answers as they stand now.

    Args:
        start: Makes a session that has seen nothing.
        feed: Lets a session see the last answer of a ledger, having seen the ones before.
    """

    def __init__(
        self, start: Callable[[], Session], feed: Callable[[Session, Ledger], None]
    ) -> None:
        self._start, self._feed = start, feed
        self._seen = Ledger()
        self._session: Session | None = None

    def at(self, ledger: Ledger) -> Session:
        """A session that has seen all answers of `ledger`, and no more."""
        past = self._seen.answered
        if self._session is None or ledger.until(past) != self._seen:
            self._session, past = self._start(), 0
        session, self._session = self._session, None  # lost, should feeding fail
        for count in range(past + 1, ledger.answered + 1):
            self._feed(session, ledger.until(count))
        self._seen, self._session = ledger.until(ledger.answered), session
        return session
