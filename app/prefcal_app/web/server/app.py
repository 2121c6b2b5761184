"""Build the web application of the query window: its addresses and their handlers."""

from importlib.resources.abc import Traversable

from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.middleware.gzip import GZipMiddleware
from starlette.routing import Route

from prefcal_app.web.answers import http_error
from prefcal_app.web.api import VIEWS, Api
from prefcal_app.web.bodies import ACTIONS, JudgedRun, Nothing
from prefcal_app.web.pages import Pages
from prefcal_app.web.verifying import Verifying

from .files import Assets
from .hosts import Hosts
from .security import Guard


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
    return guarded(
        pages,
        _of_api(api, verifying or Verifying(api.reports)),
        hosts or Hosts.of("127.0.0.1", port),
        framed=framed,
    )


def guarded(pages: Pages, api: list[Route], hosts: Hosts, *, framed: bool = False) -> Starlette:
    """Return an application that serves pages and an API only to who has the secret link.

    Args:
        pages: Handlers of the pages, with their files and the secret.
        api: Routes of the API.
        hosts: Host names of the server.
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


def _of_api(api: Api, verifying: Verifying) -> list[Route]:
    gets = {"now": api.now, "history/{answer}": api.asked, "look": api.look}
    verify = {
        "verify": (verifying.start, Nothing),
        "stop_verifying": (verifying.stop, Nothing),
        "judge": (verifying.judge, JudgedRun),
    }
    posts = {"preview": api.preview, "record": api.record, "close": api.close}
    return [
        *(Route(f"/api/{name}", api.answering(do)) for name, do in gets.items()),
        *(Route(f"/api/{name}", api.answering(api.show, name)) for name in VIEWS),
        Route("/api/verification", api.answering(api.seen_of, verifying.view)),
        *(
            Route(f"/api/{name}", api.answering(api.done_of, *how, verifying.view), methods=["POST"])
            for name, how in verify.items()
        ),
        *(Route(f"/api/{name}", api.answering(do), methods=["POST"]) for name, do in posts.items()),
        *(Route(f"/api/{name}", api.answering(api.act, name), methods=["POST"]) for name in ACTIONS),
    ]
