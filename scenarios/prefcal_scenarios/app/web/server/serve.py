"""The window: the application on a socket, in a thread of its own."""

import asyncio
import secrets
import threading
import time
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import uvicorn

from prefcal_scenarios.app.session import Interview
from prefcal_scenarios.app.web.reports import Reports

from .app import make_app
from .binding import bind
from .connections import Connection
from .hosts import Hosts, in_link, seen_from_outside, warning
from .presence import Presence
from .security import LARGEST_HEAD

_GRACE = 1
"""Seconds for requests that are still being answered when the window closes."""


class Window:
    """Serves the query window while it is entered: `with Window(interview) as window:`.

    Args:
        interview: What is shown, and answered.
        host: Name or address to listen on; of the loopback device unless others shall see it.
        port: To listen on; 0 takes a free one.
        again: The command that resumes the study, for the page.
        command: The command that repeats the study, for the page.
        clock: Seconds that never run backwards.

    Raises:
        SettingsError: the port is taken or impossible, or the host is none of this machine.
    """

    def __init__(
        self,
        interview: Interview,
        *,
        host: str = "127.0.0.1",
        port: int = 0,
        again: str = "",
        command: str = "",
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        # Bound, and listening, before anything else: a taken port must not cost a person a wait,
        # and whoever opens the link at once is only kept waiting.
        self._socket = bind(host, port)
        address, self.port = self._socket.getsockname()[:2]
        address = address.partition("%")[0]
        self._token = secrets.token_urlsafe(32)
        self._presence = Presence(clock)
        self.warning = warning(address)
        self.link = f"http://{in_link(address)}:{self.port}/open/{self._token}"
        outside = seen_from_outside(address)
        self.link_for_others = outside and f"http://{outside}:{self.port}/open/{self._token}"
        self.closed = threading.Event()
        self._reports = Reports()
        self._app = make_app(
            interview, token=self._token, port=self.port, hosts=Hosts.of(address, self.port),
            reports=self._reports, again=again, command=command, closed=self.closed,
            seen=self._presence.seen,
        )  # fmt: skip
        self._reports.changed = self._app.state.watch.wake
        self._server = uvicorn.Server(_config(self._app))
        self._thread = threading.Thread(target=self._serve, name="window", daemon=True)

    @property
    def reports(self) -> Path | None:
        """Folder of the finished report; None until there is one."""
        return self._reports.folder

    @reports.setter
    def reports(self, folder: Path | None) -> None:
        self._reports.put(folder)

    def away(self) -> float | None:
        """Return for how many seconds no page has been open; None before the first page."""
        return self._presence.away()

    @property
    def waiting(self) -> int:
        """How many pages wait for a change right now."""
        return int(self._app.state.watch.waiting)

    def __enter__(self) -> Self:
        self._thread.start()
        self._app.state.assets.pack_all()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Stop serving. Pages that wait for a change are answered first."""
        self._server.should_exit = True
        self._app.state.watch.stop()
        self._thread.join(timeout=_GRACE + 1)
        self._socket.close()

    def _serve(self) -> None:
        self._server.run(sockets=[self._socket])


def _connections() -> type[asyncio.Protocol]:
    """The class of our connections, which know of each other."""
    waiting: dict[str, dict[Connection, None]] = {}

    class Ours(Connection):
        """A connection of one window."""

        def __init__(self, *args: Any, **kwargs: Any) -> None:
            super().__init__(*args, waiting=waiting, **kwargs)

    return Ours


def _config(app: Callable[..., object]) -> uvicorn.Config:
    """Quiet, and nothing taken from the environment or from proxies."""
    return uvicorn.Config(
        app, loop="asyncio", http=_connections(), ws="none", lifespan="off", log_config=None,
        log_level="critical", access_log=False, proxy_headers=False, server_header=False,
        h11_max_incomplete_event_size=LARGEST_HEAD, timeout_keep_alive=30,
        timeout_graceful_shutdown=_GRACE,
    )  # fmt: skip
