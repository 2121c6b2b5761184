"""Serve an application on a socket of its own, in its own thread, behind a secret link."""

import asyncio
import secrets
import threading
from collections.abc import Callable
from typing import Any, Self

import uvicorn
from starlette.applications import Starlette

from .binding import bind
from .connections import Connection
from .hosts import Hosts, in_link, seen_from_outside, warning
from .security import LARGEST_HEAD

_GRACE = 1
"""Seconds to finish open requests when the site closes."""


Making = Callable[..., Starlette]
"""Function of `token`, `port` and `hosts` that builds the application of a site."""


class Site:
    """An application that is served inside `with`.

    Args:
        make: Function that builds the application once the port is known.
        host: Name or address to listen on; keep the loopback address unless others need access.
        port: Port to listen on; 0 takes a free one.

    Raises:
        SettingsError: If the port is taken or invalid, or the host is not this machine.
    """

    def __init__(self, make: Making, *, host: str, port: int) -> None:
        # Listen before anything else: a taken port fails at once, and a link that is opened early
        # only has to wait.
        self._socket = bind(host, port)
        address, self.port = self._socket.getsockname()[:2]
        address = address.partition("%")[0]
        token = secrets.token_urlsafe(32)
        self.warning = warning(address)
        self.link = f"http://{in_link(address)}:{self.port}/open/{token}"
        outside = seen_from_outside(address)
        self.link_for_others = outside and f"http://{outside}:{self.port}/open/{token}"
        app = make(token=token, port=self.port, hosts=Hosts.of(address, self.port))
        self._server = uvicorn.Server(_config(app))
        self._thread = threading.Thread(target=self._serve, name="window", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Stop serving."""
        self._server.should_exit = True
        self.release()
        self._thread.join(timeout=_GRACE + 1)
        # A server that is still at it on a busy machine closes the socket itself in the end.
        if not self._thread.is_alive():
            self._socket.close()

    def release(self) -> None:
        """Answer all requests that wait; no new one is accepted any more."""

    def _serve(self) -> None:
        self._server.run(sockets=[self._socket])


def _connections() -> type[asyncio.Protocol]:
    """Return a connection class whose instances share their list of waiting connections."""
    waiting: dict[str, dict[Connection, None]] = {}

    class Ours(Connection):
        """A connection of one window."""

        def __init__(self, *args: Any, **kwargs: Any) -> None:
            super().__init__(*args, waiting=waiting, **kwargs)

    return Ours


def _config(app: Callable[..., object]) -> uvicorn.Config:
    """Return uvicorn settings: no log, and nothing taken from the environment or proxies."""
    return uvicorn.Config(
        app,
        loop="asyncio",
        http=_connections(),
        ws="none",
        lifespan="off",
        log_config=None,
        log_level="critical",
        access_log=False,
        proxy_headers=False,
        server_header=False,
        h11_max_incomplete_event_size=LARGEST_HEAD,
        timeout_keep_alive=30,
        timeout_graceful_shutdown=_GRACE,
    )
