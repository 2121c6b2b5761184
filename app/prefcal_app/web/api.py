"""Handle the requests of the page's script."""

import threading
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from types import MappingProxyType
from typing import Any

import anyio
import anyio.to_thread
from msgspec import Struct
from starlette.background import BackgroundTask
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import Response

from prefcal_app.session import Given, Interview, Now, Phase
from prefcal_app.view import (
    Seen,
    asked_view,
    brief_view,
    history_view,
    look_view,
    map_view,
    now_view,
    preview_view,
    status_view,
)
from prefcal_env.errors import StaleError

from .answers import Handler, as_json, encoded, error_response, refused
from .bodies import (
    ACTIONS,
    MalformedError,
    Nothing,
    bit,
    digits,
    number_of_answer,
    numbers,
    read_json,
    read_query,
)
from .pages import Reports

VIEWS: Mapping[str, Callable[[Interview], Any]] = MappingProxyType(
    {"brief": brief_view, "history": history_view, "status": status_view, "simulated": map_view}
)
"""Branches of the view that follow from the interview alone."""
_TABS = 100
"""Number of pages that wait for a change at the same time; more take turns."""
_SLICE, _PAUSE = 0.2, 0.01
"""Seconds that a page waits in a row, and between two waits: a closed interview returns at once."""
_BLIND = {"blind": bit}
_RECORD = {"index": digits, "unsafe": bit, "again": bit, "theta": numbers, **_BLIND}


@dataclass(frozen=True, slots=True)
class Pace:
    """How long a page may wait for a response, in seconds.

    Args:
        poll: Longest wait for a change.
        after_answer: Longest wait for the next question, which is often ready sooner.
    """

    poll: float = 10.0
    after_answer: float = 1.0


@dataclass(frozen=True, slots=True)
class Api:
    """Handlers of the JSON addresses. Everything that uses the interview runs in a thread.

    Args:
        interview: Interview to answer.
        reports: Location of its report, known at the end.
        closed: Event to set when the person closes the window.
        seen: Function to call whenever a page asks for the current state; its argument says
            whether the page waits for a change.
        pace: How long pages may wait.
        again: Command that resumes the study.
        command: Command that repeats the study from the start.
        stopping: Event to set when no page may wait any more.
        waiting: What limits the pages that wait: theirs are not the threads of answers.
    """

    interview: Interview
    reports: Reports
    closed: threading.Event
    seen: Callable[[bool], None]
    pace: Pace = field(default_factory=Pace)
    again: str = ""
    command: str = ""
    stopping: threading.Event = field(default_factory=threading.Event)
    waiting: anyio.CapacityLimiter = field(default_factory=lambda: anyio.CapacityLimiter(_TABS))
    _lock: threading.Lock = field(default_factory=threading.Lock)
    _drawing: threading.Lock = field(default_factory=threading.Lock)
    _seen: Seen = field(default_factory=Seen)
    _kept: dict[object, tuple[object, bytes]] = field(default_factory=dict)

    def answering(self, do: Callable[..., Awaitable[Response]], *given: Any) -> Handler:
        """Return the handler that calls `do(request, *given)` and tells its errors in a sentence.

        After a stale request, the current state is added.
        """

        async def handler(request: Request) -> Response:
            try:
                return await do(request, *given)
            except HTTPException:
                raise
            except Exception as error:
                status, words, kind = refused(error)
                return error_response(status, words, kind, await self._stand(request, error))

        return handler

    async def now(self, request: Request) -> Response:
        """Return the current state; with `after`, wait until its version differs from that."""
        query = _query(request, {"after": digits, **_BLIND})
        after = query.get("after")
        self.seen(after is not None)
        if after is not None and (await self._now()).version == after:
            await self._change(after, self.pace.poll)
            self.seen(True)
        return await self._shown(query)

    async def asked(self, request: Request) -> Response:
        """Return an answered question as it was shown."""
        query = _query(request, _BLIND)
        try:
            answer = number_of_answer("answer", request.path_params["answer"])
            blind = query.get("blind", False)
            return as_json(await run_in_threadpool(self._asked, answer, blind))
        except (MalformedError, StaleError) as error:
            raise HTTPException(404) from error

    async def show(self, request: Request, name: str) -> Response:
        """Return one of `VIEWS`; it is made once per version."""
        _query(request, _BLIND)
        return as_json(await run_in_threadpool(self._view, name))

    async def look(self, request: Request) -> Response:
        """Simulate a θ and return it beside the best so far; nothing is recorded."""
        query = _query(request, {"theta": numbers, **_BLIND})
        if "theta" not in query:
            raise MalformedError("The request does not say which θ to look at.")
        return as_json(await run_in_threadpool(lambda: encoded(look_view(self.interview, query["theta"]))))

    async def act(self, request: Request, name: str) -> Response:
        """Do the action `name`, whose fields are the JSON body."""
        query = _query(request, _BLIND)
        given = await _body(request, ACTIONS[name])
        return await self._done(query, partial(getattr(self.interview.steps, name), **given))

    async def record(self, request: Request) -> Response:
        """Save the record of an experiment that the person ran."""
        query, given = await _given(request)
        return await self._done(query, partial(self.interview.steps.record, given))

    async def preview(self, request: Request) -> Response:
        """Return what would be saved of a record, with its curves."""
        _, given = await _given(request)
        preview = partial(preview_view, self.interview, given)
        return as_json(await run_in_threadpool(lambda: encoded(preview())))

    async def seen_of(self, request: Request, view: Callable[[], Any]) -> Response:
        """Return what a function returns that is no branch of the interview's view."""
        _query(request, _BLIND)
        return as_json(await run_in_threadpool(lambda: encoded(view())))

    async def done_of(
        self, request: Request, do: Callable[..., None], kind: type[Struct], view: Callable[[], Any]
    ) -> Response:
        """Call a function with a body of this kind, and return what `view` returns then."""
        given = await _body(request, kind)
        await run_in_threadpool(partial(do, **given))
        return await self.seen_of(request, view)

    async def close(self, request: Request) -> Response:
        """Close the window after sending this response."""
        query = _query(request, _BLIND)
        await _body(request, Nothing)
        response = await self._shown(query)
        response.background = BackgroundTask(self.closed.set)
        return response

    async def _stand(self, request: Request, error: Exception) -> bytes:
        """Return NOW if the request was stale, null after any other error."""
        if not isinstance(error, StaleError):
            return b"null"
        try:
            query = _query(request, _RECORD)
            return bytes((await self._shown(query)).body)
        except Exception as second:
            refused(second)
            return b"null"

    async def _now(self) -> Now:
        return await run_in_threadpool(self.interview.now)

    async def _shown(self, query: dict[str, Any]) -> Response:
        return as_json(await run_in_threadpool(self._shown_now, query.get("blind", False)))

    def _shown_now(self, blind: bool) -> bytes:
        """Return NOW, made once per version: an answer must not wait for other tabs."""
        report = self.reports.folder
        view = partial(
            now_view,
            self.interview,
            blind=blind,
            again=self.again,
            command=self.command,
            report=report,
            seen=self._seen,
        )
        with self._lock:
            return self._once(blind, (self.interview.now().version, report), view)

    def _view(self, name: str) -> bytes:
        with self._drawing:
            return self._once(name, self.interview.now().version, partial(VIEWS[name], self.interview))

    def _asked(self, answer: int, blind: bool) -> bytes:
        with self._lock:  # all threads share `_seen`
            view = asked_view(self.interview, answer, blind=blind, seen=self._seen)
        return encoded(view)

    def _once(self, name: object, key: object, view: Callable[[], Any]) -> bytes:
        """Return a view as JSON, made again only if `key` has changed."""
        kept = self._kept.get(name)
        if kept is None or kept[0] != key:
            kept = self._kept[name] = (key, encoded(view()))
        return kept[1]

    async def _done(self, query: dict[str, Any], do: Callable[[], Now]) -> Response:
        """Call `do`, then return the next question if it is ready soon."""
        now = await run_in_threadpool(do)
        end = anyio.current_time() + self.pace.after_answer
        while now.phase is Phase.RUNNING and anyio.current_time() < end:
            await self._change(now.version, end - anyio.current_time())
            now = await self._now()
        return await self._shown(query)

    async def _change(self, version: int, timeout: float) -> None:
        """Return when the version differs from `version` or the report is there, or after `timeout` s."""
        report, end = self.reports.folder, anyio.current_time() + timeout
        while self.reports.folder is report and not self.stopping.is_set():
            left = end - anyio.current_time()
            if left <= 0:
                return
            wait = partial(self.interview.wait, version, min(left, _SLICE))
            if (await anyio.to_thread.run_sync(wait, limiter=self.waiting)).version != version:
                return
            await anyio.sleep(_PAUSE)


def _query(request: Request, fields: dict[str, Any]) -> dict[str, Any]:
    return read_query(request.scope["query_string"], fields)


async def _body(request: Request, kind: type[Struct]) -> dict[str, Any]:
    if not _sent_as(request, "application/json"):
        raise HTTPException(415, "The request must be JSON.")
    return read_json(await request.body(), kind)


async def _given(request: Request) -> tuple[dict[str, Any], Given]:
    """Return the parameters and the record of a request that contains a record."""
    query = _query(request, _RECORD)
    if not _sent_as(request, "text/csv"):
        raise HTTPException(415, "The record must be a CSV or Parquet file, sent as text/csv.")
    if "index" not in query:
        raise MalformedError("The request does not say which experiment the record belongs to.")
    given = Given(
        query["index"],
        await request.body(),
        query.get("unsafe", False),
        query.get("theta"),
        query.get("again", False),
    )
    return query, given


def _sent_as(request: Request, media_type: str) -> bool:
    return request.headers.get("content-type", "").partition(";")[0].strip().lower() == media_type
