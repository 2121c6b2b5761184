"""Serve runs on a local page, two at a time."""

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Self

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from prefcal_scenarios.app.web.answers import as_json, error_response, refused
from prefcal_scenarios.app.web.bodies import digits, read_query
from prefcal_scenarios.app.web.pages import Pages
from prefcal_scenarios.app.web.reports import Reports
from prefcal_scenarios.app.web.server.app import guarded
from prefcal_scenarios.app.web.server.files import Assets
from prefcal_scenarios.app.web.server.hosts import Hosts
from prefcal_scenarios.app.web.server.site import Site
from prefcal_scenarios.app.web.views import encoded

from .pair import Run, paired
from .view import pair_view

_KEPT = 8
"""Number of pairs whose views are kept: each can take megabytes."""


@dataclass(slots=True)
class Gallery:
    """Runs to look at, and the views of their pairs as JSON, made once.

    Args:
        runs: At least two runs.
        align: Whether both runs of a pair start at 0; see `paired`.
    """

    runs: Sequence[Run]
    align: bool | None = None
    _lock: threading.Lock = field(default_factory=threading.Lock)
    _kept: dict[tuple[int, int], bytes] = field(default_factory=dict)

    def listed(self) -> bytes:
        """Return the names of all runs and what was read of them."""
        return encoded({"runs": [{"name": run.name, "about": run.about} for run in self.runs]})

    def pair(self, left: int, right: int) -> bytes:
        """Return a pair of runs, by their positions from 0."""
        with self._lock:
            if (left, right) not in self._kept:
                while len(self._kept) >= _KEPT:
                    del self._kept[next(iter(self._kept))]
                made = paired(self.runs[left], self.runs[right], align=self.align)
                self._kept[left, right] = encoded(pair_view(made))
            return self._kept[left, right]


class LookWindow:
    """The page of some runs, served inside `with LookWindow(gallery) as window:`.

    Args:
        gallery: Runs to show.
        host: Name or address to listen on; keep the loopback address unless others need access.
        port: Port to listen on; 0 takes a free one.

    Raises:
        SettingsError: If the port is taken or invalid, or the host is not this machine.
    """

    def __init__(self, gallery: Gallery, *, host: str = "127.0.0.1", port: int = 0) -> None:
        def make(*, token: str, port: int, hosts: Hosts) -> Starlette:
            pages = Pages(Assets(), Reports(), token, port, "look.html")
            return guarded(pages, _routes(gallery), hosts)

        self._site = Site(make, host=host, port=port)
        self.link, self.link_for_others = self._site.link, self._site.link_for_others
        self.warning = self._site.warning

    def __enter__(self) -> Self:
        self._site.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Stop serving."""
        self._site.stop()


def _routes(gallery: Gallery) -> list[Route]:
    async def runs(request: Request) -> Response:
        """Return the list of runs."""
        return await _answer(gallery.listed)

    async def pair(request: Request) -> Response:
        """Return two runs."""
        return await _answer(_pair, gallery, request.scope["query_string"])

    return [Route("/api/runs", runs), Route("/api/pair", pair)]


def _pair(gallery: Gallery, query: bytes) -> bytes:
    chosen = read_query(query, {"left": digits, "right": digits})
    places = chosen.get("left", 0), chosen.get("right", 1)
    if max(places) >= len(gallery.runs):
        raise HTTPException(404)
    return gallery.pair(*places)


async def _answer(view: Callable[..., bytes], *arguments: Any) -> Response:
    try:
        return as_json(await run_in_threadpool(view, *arguments))
    except HTTPException:
        raise
    except Exception as error:
        return error_response(*refused(error))
