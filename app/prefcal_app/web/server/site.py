"""Serve an application on a socket of its own, in its own thread, behind a secret link."""

import asyncio
import errno
import secrets
import socket
import threading
from collections.abc import Callable
from typing import Any, Self

import uvicorn
from starlette.applications import Starlette

from prefcal_env.errors import SettingsError

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


def bind(host: str, port: int) -> socket.socket:
    """Return a socket that listens on `host` and `port`; port 0 takes a free one.

    Raises:
        SettingsError: If the port is taken or invalid, or the host is not this machine.
    """
    if not 0 <= port <= 65535:
        raise SettingsError(f"port must be in [0, 65535] (0: any free port), got {port}")
    try:
        found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
    except (OSError, UnicodeError) as error:
        raise SettingsError(
            f"host {host!r} cannot be resolved: expected a name or address of this machine"
        ) from error
    # With IPv6, "localhost" has two addresses; the IPv4 one works everywhere.
    family, *_, address = min(found, key=lambda one: one[0] is not socket.AF_INET)
    try:
        listening = socket.create_server(address, family=family, backlog=128)
    except OSError as error:
        raise SettingsError(_in_words(error, host, port)) from error
    # Connections inherit it. Otherwise the second part of each response waits about 40 ms for the
    # peer's delayed acknowledgment; asyncio sets it only on sockets that name their protocol.
    listening.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return listening


def _in_words(error: OSError, host: str, port: int) -> str:
    if error.errno == errno.EADDRINUSE:
        return f"port {port} on {host} is taken: choose another, or 0 for any free port"
    if error.errno == errno.EACCES:
        return f"port {port} needs administrator rights: choose 1024 or higher, or 0 for a free one"
    if error.errno == errno.EADDRNOTAVAIL:
        return f"host {host!r} is not an address of this machine; 127.0.0.1 always works"
    return f"cannot listen on port {port} on {host}: {error.strerror or error}"
