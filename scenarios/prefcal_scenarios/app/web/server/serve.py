"""Serve the application on a socket, in its own thread."""

import asyncio
import secrets
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Self

import uvicorn

from prefcal_scenarios.app.session import Interview
from prefcal_scenarios.app.web.api import Api
from prefcal_scenarios.app.web.reports import Reports
from prefcal_scenarios.app.web.views import Views
from prefcal_scenarios.app.web.watch import Watch

from .app import make_app
from .binding import bind
from .connections import Connection
from .hosts import Hosts, in_link, seen_from_outside, warning
from .security import LARGEST_HEAD

_GRACE = 1
"""Seconds to finish open requests when the window closes."""
_HIDDEN = 70.0
"""Seconds that a page in a hidden tab may be silent; browsers wake it once a minute."""


class Presence:
    """A record of when a page was last open.

    Args:
        clock: Monotonic clock, in seconds.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._until: float | None = None

    def seen(self, waits: bool) -> None:
        """Note that a page asked for the current state, or that its wait ended.

        Args:
            waits: Whether the page waits for the next change. A page in a hidden tab does not; it
                only asks from time to time.
        """
        self._until = self._clock() + (0.0 if waits else _HIDDEN)

    def away(self) -> float | None:
        """Return the seconds since a page was last open; None before the first page."""
        return None if self._until is None else max(0.0, self._clock() - self._until)


class Window:
    """The query window, served inside `with Window(interview) as window:`.

    Args:
        interview: Interview to show and answer.
        host: Name or address to listen on; keep the loopback address unless others need access.
        port: Port to listen on; 0 takes a free one.
        again: Command that resumes the study, shown on the page.
        command: Command that repeats the study, shown on the page.
        clock: Monotonic clock, in seconds.

    Raises:
        SettingsError: If the port is taken or invalid, or the host is not this machine.
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
        # Listen before anything else: a taken port fails at once, and a link that is opened early
        # only has to wait.
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
        self._watch = Watch(interview)
        self._reports.changed = self._watch.wake
        views = Views(interview, self._reports, again, command)
        api = Api(interview, views, self._watch, self.closed, self._presence.seen)
        self._app = make_app(
            api, token=self._token, port=self.port, hosts=Hosts.of(address, self.port)
        )
        self._server = uvicorn.Server(_config(self._app))
        self._thread = threading.Thread(target=self._serve, name="window", daemon=True)

    @property
    def reports(self) -> Path | None:
        """Return the folder of the finished report; None until there is one."""
        return self._reports.folder

    @reports.setter
    def reports(self, folder: Path | None) -> None:
        self._reports.put(folder)

    def away(self) -> float | None:
        """Return the seconds since a page was last open; None before the first page."""
        return self._presence.away()

    @property
    def waiting(self) -> int:
        """Return the number of pages that wait for a change."""
        return self._watch.waiting

    def __enter__(self) -> Self:
        self._thread.start()
        self._app.state.assets.pack_all()
        return self

    def __exit__(self, *_: object) -> None:
        """Stop serving. Pages that wait for a change get a response first."""
        self._server.should_exit = True
        self._watch.stop()
        self._thread.join(timeout=_GRACE + 1)
        self._socket.close()

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
        app, loop="asyncio", http=_connections(), ws="none", lifespan="off", log_config=None,
        log_level="critical", access_log=False, proxy_headers=False, server_header=False,
        h11_max_incomplete_event_size=LARGEST_HEAD, timeout_keep_alive=30,
        timeout_graceful_shutdown=_GRACE,
    )  # fmt: skip
