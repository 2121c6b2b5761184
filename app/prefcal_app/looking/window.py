"""Serve runs on a local page, two at a time."""

from collections.abc import Awaitable, Callable, Sequence
from functools import lru_cache

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from prefcal_app.web.answers import as_json, encoded, error_response, refused
from prefcal_app.web.bodies import digits, read_query
from prefcal_app.web.pages import Pages, Reports
from prefcal_app.web.server.app import guarded
from prefcal_app.web.server.files import Assets
from prefcal_app.web.server.hosts import Hosts
from prefcal_app.web.server.site import Site

from .pair import NamedRun, aligned, aligned_view

_KEPT = 8
"""Number of pairs whose views are kept: each can take megabytes."""


class LookWindow(Site):
    """The page of some runs, served inside `with LookWindow(runs) as window:`.

    Args:
        runs: At least two runs.
        align: Whether both runs of a pair start at 0; see `aligned`.
        host: Name or address to listen on; keep the loopback address unless others need access.
        port: Port to listen on; 0 takes a free one.

    Raises:
        SettingsError: If the port is taken or invalid, or the host is not this machine.
    """

    def __init__(
        self, runs: Sequence[NamedRun], *, align: bool | None = None, host: str = "127.0.0.1", port: int = 0
    ) -> None:
        def make(*, token: str, port: int, hosts: Hosts) -> Starlette:
            pages = Pages(Assets(), Reports(), token, port, "look.html")
            return guarded(pages, _routes(runs, align), hosts)

        super().__init__(make, host=host, port=port)


def _routes(runs: Sequence[NamedRun], align: bool | None) -> list[Route]:
    @lru_cache(_KEPT)
    def pair(left: int, right: int) -> bytes:
        return encoded(aligned_view(*aligned(runs[left], runs[right], align=align)))

    def listed(query: bytes) -> bytes:
        return encoded({"runs": [{"name": run.name, "about": run.about} for run in runs]})

    def chosen(query: bytes) -> bytes:
        places = read_query(query, {"left": digits, "right": digits})
        left, right = places.get("left", 0), places.get("right", 1)
        if max(left, right) >= len(runs):
            raise HTTPException(404)
        return pair(left, right)

    return [Route("/api/runs", _endpoint(listed)), Route("/api/pair", _endpoint(chosen))]


def _endpoint(view: Callable[[bytes], bytes]) -> Callable[[Request], Awaitable[Response]]:
    async def answer(request: Request) -> Response:
        try:
            return as_json(await run_in_threadpool(view, request.scope["query_string"]))
        except HTTPException:
            raise
        except Exception as error:
            return error_response(*refused(error))

    return answer
