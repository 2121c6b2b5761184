"""Serve the query window of an interview."""

import threading
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

from prefcal_app.session import Interview
from prefcal_app.web.api import Api
from prefcal_app.web.pages import Reports
from prefcal_app.web.verifying import Verifying

from .app import make_app
from .site import Site

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


class Window(Site):
    """The query window, served inside `with Window(interview) as window:`.

    Args:
        interview: Interview to show and answer.
        host: Name or address to listen on; keep the loopback address unless others need access.
        port: Port to listen on; 0 takes a free one.
        again: Command that resumes the study, shown on the page.
        command: Command that repeats the study, shown on the page.
        framed: Whether pages of this machine, such as a notebook, may show the window in a frame.
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
        framed: bool = False,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._presence = Presence(clock)
        self.closed = threading.Event()
        self._reports = Reports()
        seen = self._presence.seen
        self._api = Api(interview, self._reports, self.closed, seen, again=again, command=command)
        self._verifying = Verifying(self._reports)
        application = partial(make_app, self._api, framed=framed, verifying=self._verifying)
        super().__init__(application, host=host, port=port)

    @property
    def reports(self) -> Path | None:
        """Return the folder of the finished report; None until there is one."""
        return self._reports.folder

    @reports.setter
    def reports(self, folder: Path | None) -> None:
        self._reports.folder = folder

    def away(self) -> float | None:
        """Return the seconds since a page was last open; None before the first page."""
        return self._presence.away()

    @property
    def waiting(self) -> int:
        """Return the number of pages that wait for a change."""
        return self._api.waiting.borrowed_tokens

    @property
    def verifying(self) -> bool:
        """Whether the result is being verified."""
        return self._verifying.running

    def release(self) -> None:
        """Answer the pages that wait for a change; end a verification, whose runs so far are kept."""
        self._api.stopping.set()
        self._verifying.close()
