"""Serve the page: the application, its site and thread, and the browser that opens it."""

import errno
import os
import secrets
import socket
import sys
import threading
import time
import webbrowser
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Self

import uvicorn
from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.middleware.gzip import GZipMiddleware
from starlette.routing import Route

from prefcal_app.session import Interview
from prefcal_env.errors import SettingsError

from .api import SENT, VIEWS, Api, JudgedRun, Nothing, Pages, Reports, Verifying, http_error
from .security import LARGEST_HEAD, Assets, Connection, Guard, Hosts, in_link, seen_from_outside, warning

# --- Open the window's link in a graphical browser, if there is one.

_TEXT = frozenset({"www-browser", "links", "elinks", "lynx", "w3m", "links2"})
"""Browsers that would take over the terminal and do not run scripts."""
_NO_DISPLAY_NEEDED = ("win32", "cygwin", "darwin")


def open_browser(
    link: str, *, environ: Mapping[str, str] | None = None, platform: str = sys.platform
) -> bool:
    """Open `link` in a graphical browser and return whether one opened. Prints nothing.

    Args:
        environ: Environment variables; those of this process if None.
        platform: Platform name, as in `sys.platform`.
    """
    variables = os.environ if environ is None else environ
    display = any(variables.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))
    if not display and platform not in _NO_DISPLAY_NEEDED:
        return False
    try:
        browser = webbrowser.get()
        # One that runs in the foreground needs the terminal, too.
        name = os.path.basename(str(getattr(browser, "name", "")))
        text = name in _TEXT or type(browser) is webbrowser.GenericBrowser
        return not text and bool(browser.open(link))
    except (webbrowser.Error, OSError):
        return False


# --- Serve an application on a socket of its own, in its own thread, behind a secret link.

_GRACE = 1  # seconds to finish open requests when the site closes

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
        run = partial(self._server.run, sockets=[self._socket])
        self._thread = threading.Thread(target=run, name="window", daemon=True)

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


def _config(app: Callable[..., object]) -> uvicorn.Config:
    """Return uvicorn settings: no log, and nothing taken from the environment or proxies."""
    return uvicorn.Config(
        app,
        loop="asyncio",
        http=partial(Connection, waiting={}),  # type: ignore[arg-type]  # uvicorn only calls it
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


# --- Build the web application of the query window: its addresses and their handlers.


def make_app(
    api: Api,
    *,
    token: str,
    port: int,
    hosts: Hosts | None = None,
    static: Traversable | None = None,
    framed: bool = False,
    verifying: Verifying | None = None,
) -> Starlette:
    """Return the application, for any ASGI server.

    Args:
        api: Handlers of the JSON addresses.
        token: Secret of the link.
        port: Port of the server.
        hosts: Host names of the server; the loopback names if None.
        static: Folder of the page's files; the package's own if None.
        framed: Whether pages of this machine may show the window in a frame.
        verifying: What verifies the result; one of its own if None.
    """
    pages = Pages(Assets(static), api.reports, token, port)
    routes = _api_routes(api, verifying or Verifying(api.reports))
    return guard(pages, routes, hosts or Hosts.of("127.0.0.1", port), framed=framed)


def guard(pages: Pages, api: list[Route], hosts: Hosts, *, framed: bool = False) -> Starlette:
    """Return an application that serves pages and an API only to who has the secret link.

    Args:
        pages: Handlers of the pages, with their files and the secret.
        framed: Whether pages of this machine may show the window in a frame.
    """
    app = Starlette(
        routes=[
            Route("/", pages.index),
            Route("/open/{token}", pages.open),
            Route("/static/{file}", pages.static),
            Route("/report/{file}", pages.report),
            *api,
        ],
        middleware=[
            Middleware(Guard, token=pages.token, hosts=hosts, framed=framed),
            # Through a tunnel plotly.js would take seconds otherwise.
            Middleware(GZipMiddleware, minimum_size=10_000, compresslevel=4),
        ],
        exception_handlers={HTTPException: http_error},
    )
    # A redirect would repeat the Host header, for addresses that the page never asks for.
    app.router.redirect_slashes = False
    return app


def _api_routes(api: Api, verifying: Verifying) -> list[Route]:
    gets = {"now": api.now, "history/{answer}": api.show_answered, "look": api.look}
    verify = {
        "verify": (verifying.start, Nothing),
        "stop_verifying": (verifying.stop, Nothing),
        "judge": (verifying.judge, JudgedRun),
    }
    posts = {"preview": api.preview, "record": api.record, "close": api.close}
    return [
        *(Route(f"/api/{name}", api.answering(do)) for name, do in gets.items()),
        *(Route(f"/api/{name}", api.answering(api.show, name)) for name in VIEWS),
        Route("/api/verification", api.answering(api.get_view, verifying.view)),
        *(
            Route(f"/api/{name}", api.answering(api.call, *how, verifying.view), methods=["POST"])
            for name, how in verify.items()
        ),
        *(Route(f"/api/{name}", api.answering(do), methods=["POST"]) for name, do in posts.items()),
        *(Route(f"/api/{name}", api.answering(api.act, name), methods=["POST"]) for name in SENT),
    ]


# --- Serve the query window of an interview.

_HIDDEN = 70.0  # seconds that a page in a hidden tab may be silent; browsers wake it once a minute


class Presence:
    """A record of when a page was last open."""

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
    """The query window, a `Site` of its own, served inside `with Window(interview) as window:`.

    Args:
        again: Command that resumes the study, shown on the page.
        command: Command that repeats the study, shown on the page.
        remarks: What is no longer as it was when the study was begun, shown on the page.
        framed: Whether pages of this machine, such as a notebook, may show the window in a frame.
    """

    def __init__(
        self,
        interview: Interview,
        *,
        host: str = "127.0.0.1",
        port: int = 0,
        again: str = "",
        command: str = "",
        remarks: Sequence[str] = (),
        framed: bool = False,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._presence = Presence(clock)
        self.closed = threading.Event()
        self._reports = Reports()
        seen = self._presence.seen
        self._api = Api(
            interview, self._reports, self.closed, seen, again=again, command=command, remarks=remarks
        )
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
