"""Build the web application of the query window: its addresses and their handlers."""

import threading
from collections.abc import Callable
from importlib.resources.abc import Traversable

from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.routing import Route

from prefcal_scenarios.app.session import Interview
from prefcal_scenarios.app.web.actions import ACTIONS
from prefcal_scenarios.app.web.answers import http_error
from prefcal_scenarios.app.web.api import Api, Pace
from prefcal_scenarios.app.web.pages import Pages
from prefcal_scenarios.app.web.reports import Reports
from prefcal_scenarios.app.web.views import Views
from prefcal_scenarios.app.web.watch import Watch

from .files import Assets
from .hosts import Hosts
from .security import Guard


def make_app(
    interview: Interview,
    *,
    token: str,
    port: int,
    hosts: Hosts | None = None,
    reports: Reports | None = None,
    again: str = "",
    command: str = "",
    closed: threading.Event | None = None,
    seen: Callable[[bool], None] = lambda waits: None,
    pace: Pace | None = None,
    static: Traversable | None = None,
) -> Starlette:
    """Return the application, for any ASGI server.

    `state.watch` of the application wakes every waiting page; `state.assets` holds the files.

    Args:
        interview: Interview to show and answer.
        token: Secret of the link.
        port: Port of the server.
        hosts: Host names of the server; the loopback names if None.
        reports: Location of the finished report.
        again: Command that resumes the study.
        command: Command that repeats the study from the start.
        closed: Event to set when the person closes the window.
        seen: Function to call whenever a page asks for the current state; its argument says
            whether the page waits for a change.
        pace: How long pages may wait.
        static: Folder of the page's files; the package's own if None.
    """
    reports = Reports() if reports is None else reports
    watch, assets = Watch(interview), Assets(static)
    api = Api(
        interview=interview, views=Views(interview, reports, again, command), watch=watch,
        closed=closed or threading.Event(), seen=seen, pace=pace or Pace(),
    )  # fmt: skip
    app = Starlette(
        routes=[*_of_pages(Pages(assets, reports, token, port)), *_of_api(api)],
        middleware=[
            Middleware(Guard, token=token, hosts=hosts or Hosts.of("127.0.0.1", port)),
        ],
        exception_handlers={HTTPException: http_error},
    )
    # A redirect would repeat the Host header, for addresses that the page never asks for.
    app.router.redirect_slashes = False
    app.state.watch, app.state.assets = watch, assets
    return app


def _of_pages(pages: Pages) -> list[Route]:
    return [
        Route("/", pages.index),
        Route("/open/{token}", pages.open),
        Route("/static/{file}", pages.static),
        Route("/report/{file}", pages.report),
    ]


def _of_api(api: Api) -> list[Route]:
    posts = [
        Route(f"/api/{name}", api.acting(action), methods=["POST"])
        for name, action in ACTIONS.items()
    ]
    return [
        Route("/api/now", api.now),
        Route("/api/brief", api.brief),
        Route("/api/history", api.history),
        Route("/api/history/{answer}", api.asked),
        Route("/api/status", api.status),
        Route("/api/preview", api.preview, methods=["POST"]),
        Route("/api/record", api.record, methods=["POST"]),
        Route("/api/close", api.close, methods=["POST"]),
        *posts,
    ]
