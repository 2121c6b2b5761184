"""Limit connections that keep the window waiting, in time and in number per peer."""

import asyncio
from typing import Any

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

from .security import BODY_SECONDS

HEAD_SECONDS = 10.0
"""Seconds within which the address and the headers of a request must arrive."""
MOST_WAITING = 32
"""Maximum number of connections per peer without a complete request; browsers open six."""
_AFTER = 5.0
"""Extra seconds after `BODY_SECONDS`, for sending the error to the person."""

_BUSY = (
    b"HTTP/1.1 503 Service Unavailable\r\nRetry-After: 1\r\nConnection: close\r\n"
    b"Content-Type: text/plain\r\nContent-Length: 22\r\n\r\nToo many connections.\n"
)
"""What a connection is told that has to make way for a newer one."""

_Waiting = dict[str, dict["Connection", None]]


class Connection(H11Protocol):
    """A uvicorn connection that closes if its request does not arrive.

    If a peer has too many of them, the oldest one is answered with 503 and closes: an honest
    request arrives at once.
    """

    def __init__(self, *args: Any, waiting: _Waiting, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self._waiting = waiting
        self._timer: asyncio.TimerHandle | None = None
        self._timed: Any = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Wait for the first request."""
        super().connection_made(transport)
        self._expect()

    def data_received(self, data: bytes) -> None:
        """Process received data, then wait for what is still missing."""
        super().data_received(data)
        self._expect()

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget the connection."""
        self._rest()
        super().connection_lost(exc)

    def _expect(self) -> None:
        """Start the timer of the head or body that is expected now; a running one continues."""
        awaited = self.conn.their_state
        if awaited is self._timed:
            return
        self._rest()
        if awaited not in (h11.IDLE, h11.SEND_BODY):
            return  # the request is complete
        self._timed = awaited
        seconds = HEAD_SECONDS if awaited is h11.IDLE else BODY_SECONDS + _AFTER
        self._timer = self.loop.call_later(seconds, self.drop)
        of_peer = self._waiting.setdefault(self._peer, {})
        of_peer[self] = None
        if len(of_peer) > MOST_WAITING:
            next(iter(of_peer)).make_way()

    def make_way(self) -> None:
        """Close the connection, and say to whoever still listens that there are too many."""
        self._rest()
        self.transport.write(_BUSY)
        self.transport.close()

    def drop(self) -> None:
        """Close the connection at once."""
        self._rest()
        self.transport.abort()

    def _rest(self) -> None:
        """Stop the timer: nothing is expected."""
        self._timed = None
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        of_peer = self._waiting.get(self._peer, {})
        of_peer.pop(self, None)
        if not of_peer:
            self._waiting.pop(self._peer, None)

    @property
    def _peer(self) -> str:
        return self.client[0] if self.client else ""
