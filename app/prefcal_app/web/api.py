"""The requests of the page: their bodies, what they do, what they return, and the pages themselves."""

import json
import logging
import re
import threading
from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import count
from math import isfinite
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeVar
from urllib.parse import parse_qsl

import anyio
import anyio.to_thread
import msgspec
from msgspec import Struct
from starlette.background import BackgroundTask
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response

from prefcal_app import report
from prefcal_app.session import Interview, Phase, actions
from prefcal_app.session.actions import Text, Whole
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
from prefcal_env.errors import PrefcalError, RecordError, StaleError, StudyError
from prefcal_scenarios import verification

from .security import NO_COOKIE, REPORT_POLICY, Assets, cookie, same

# --- Say what a page can do, and check strictly what it sends: exact names and types, bounded sizes.

SENT: Mapping[str, type[actions.Action]] = MappingProxyType(
    {name: kind for name, kind in actions.ACTIONS.items() if kind not in (actions.Give, actions.Record)}
)
"""Actions that a page sends as JSON; a record is a file, and programs alone give other answers."""
Body = TypeVar("Body", bound=Struct)


class Nothing(Struct, forbid_unknown_fields=True):
    """Body without fields."""


class JudgedRun(Struct, forbid_unknown_fields=True):
    """A verdict on one of the worst runs of a verification of the tuning with the digest `best`."""

    run: Whole
    seed: Whole
    best: Text
    acceptable: bool


Check = Callable[[str, str], Any]
"""Function of a parameter's name and text that returns its value or raises MalformedError."""


class MalformedError(ValueError):
    """A request that prefcal's page never sends; the text is a sentence for the person."""


def read_json(body: bytes, kind: type[Body]) -> Body:
    """Return the JSON object in `body`, which must have exactly the fields of `kind`.

    Raises:
        MalformedError: If it is not JSON in UTF-8, or has other fields or values. Of two fields of
            the same name, the second counts.
    """
    try:
        found = msgspec.json.decode(body, type=kind)
        # Defaults are for Python: a page that leaves a field out is that of another version.
        sent = msgspec.json.decode(body)
        missing = [name for name in kind.__struct_fields__ if name not in sent]
    except msgspec.ValidationError as error:
        raise MalformedError(f"The request does not fit: {error}.") from error
    except (msgspec.DecodeError, ValueError, RecursionError) as error:
        raise MalformedError("The request is not JSON in UTF-8.") from error
    if missing:
        raise MalformedError(f"The request does not fit: Object missing required field `{missing[0]}`.")
    return found


def read_query(query: bytes, fields: Mapping[str, Check]) -> dict[str, Any]:
    """Return the checked parameters after the "?" of an address; each is optional.

    Raises:
        MalformedError: If there are other or repeated parameters, or a value fails a check.
    """
    try:
        # Strict parsing refuses an empty query, which is allowed here.
        strict: Any = {"keep_blank_values": True, "strict_parsing": True, "errors": "strict"}
        pairs = parse_qsl(query.decode("ascii"), **strict, max_num_fields=8) if query else []
    except ValueError as error:
        raise MalformedError("The address has parameters that cannot be read.") from error
    found = dict(pairs)
    if len(found) != len(pairs) or any(name not in fields for name in found):
        raise MalformedError("The request has unknown fields, or one twice.")
    return {name: fields[name](name, value) for name, value in found.items()}


def _match(pattern: str, read: Callable[[str], Any], words: str) -> Check:
    """Return a check of what is written in an address; `words` say what it must be."""

    def check(name: str, value: str) -> Any:
        if not re.fullmatch(pattern, value):
            raise MalformedError(f"{name} must be {words}.")
        return read(value)

    return check


digits = _match("[0-9]{1,15}", int, "a whole number, 0 or more")
number_of_answer = _match("-?[1-9][0-9]{0,14}", int, "a whole number other than 0")
bit = _match("[01]", lambda text: text == "1", "0 or 1")


def numbers(name: str, value: str) -> tuple[float, ...]:
    """Return the finite numbers that are written in an address, separated by commas."""
    try:
        found = tuple(float(part) for part in value.split(","))
    except ValueError as error:
        raise MalformedError(f"{name} must be numbers separated by commas.") from error
    if not all(map(isfinite, found)):
        raise MalformedError(f"{name} must be finite.")
    return found


# --- Build the server's responses: JSON, and errors as sentences for the person.

Handler = Callable[[Request], Awaitable[Response]]

_KINDS: tuple[tuple[type[Exception], int, str], ...] = (
    (MalformedError, 400, "refused"),
    (StaleError, 409, "stale"),
    (RecordError, 422, "record"),
    (StudyError, 507, "study"),
    (PrefcalError, 422, "refused"),
)
"""Error, status and kind; the first match counts."""
_WORDS = {404: "There is nothing at this address.", 405: "This address does not accept that kind of request."}


def to_json(view: Any) -> bytes:
    """Return JSON in UTF-8; NaN and infinite numbers become null."""
    return msgspec.json.encode(view, enc_hook=lambda number: number.item())


def as_json(content: bytes, status: int = 200) -> Response:
    """Return a response with JSON that is already encoded."""
    return Response(content, status, media_type="application/json")


def error_response(status: int, error: str, kind: str, now: bytes = b"null") -> Response:
    """Return an error: a sentence for the person, its kind and the current state for the script."""
    head = json.dumps({"error": error, "kind": kind})[:-1].encode()
    return as_json(head + b', "now": ' + now + b"}", status)


def explain(error: Exception) -> tuple[int, str, str]:
    """Return status, sentence and kind of an error.

    Any error that is not one of prefcal's own is a bug: it is logged and reported to the person.
    """
    for type_, status, kind in _KINDS:
        if isinstance(error, type_):
            return status, str(error), kind
    logging.getLogger(__name__).error("a request failed", exc_info=error)
    return 500, f"prefcal failed because of a bug in it ({type(error).__name__}: {error}).", "refused"


async def http_error(request: Request, error: Exception) -> Response:
    """Return the response to an address or a method that does not exist."""
    assert isinstance(error, HTTPException)
    words = _WORDS.get(error.status_code, str(error.detail))
    if request.scope["path"].startswith("/api/"):
        return error_response(error.status_code, words, "refused")
    return PlainTextResponse(words, error.status_code)


# --- Serve the page, its files, and the files of the finished report.

TYPES: Mapping[str, str] = {
    ".png": "image/png",
    ".csv": "text/csv; charset=utf-8",
    ".json": "application/json",
    ".html": "text/html; charset=utf-8",
}


@dataclass(slots=True)
class Reports:
    """The location of the finished report, known only at the end."""

    folder: Path | None = None  # folder of the report; None until it is written

    def read(self, name: str) -> tuple[bytes, str] | None:
        """Return content and type of the report's file `name`, or None if it cannot be shown."""
        media_type = TYPES.get(Path(name).suffix)
        if self.folder is None or media_type is None or name.startswith("."):
            return None
        try:
            # Compare with existing names instead of joining paths: no name can leave the folder.
            for path in self.folder.iterdir():
                if path.name == name and path.is_file() and not path.is_symlink():
                    return path.read_bytes(), media_type
        except OSError:
            pass
        return None


@dataclass(frozen=True, slots=True)
class Pages:
    """Handlers of everything that a browser loads without a script."""

    assets: Assets  # files of the page
    reports: Reports  # finished report
    token: str  # secret of the link
    port: int  # port, part of the cookie's name
    page: str = "index.html"  # file of the page that the link opens

    async def open(self, request: Request) -> Response:
        """Return the page and set the cookie that all other requests need."""
        if not same(request.path_params["token"], self.token):
            return PlainTextResponse(NO_COOKIE.error, NO_COOKIE.status)
        response = await self.index(request)
        response.headers["set-cookie"] = cookie(self.token, self.port)
        return response

    async def index(self, request: Request) -> Response:
        """Return the page."""
        return self.assets.response(self.page, request)

    async def static(self, request: Request) -> Response:
        """Return a file of the page."""
        return self.assets.response(request.path_params["file"], request)

    async def report(self, request: Request) -> Response:
        """Return a file of the report; its page has its own scripts and runs in a sandbox."""
        found = await run_in_threadpool(self.reports.read, request.path_params["file"])
        if found is None:
            raise HTTPException(404)
        content, media_type = found
        html = media_type.startswith("text/html")
        headers = {"content-security-policy": REPORT_POLICY} if html else {}
        return Response(content, headers=headers, media_type=media_type)


# --- Verify the result on varied plants while the page of its end is open.

_PATIENCE = 10.0  # seconds that closing waits for the runs in progress, whose result is then kept


class Verifying:
    """The verification of the finished report's tuning, in a thread of its own."""

    def __init__(self, reports: Reports) -> None:
        self._reports, self._lock = reports, threading.Lock()
        self._thread: threading.Thread | None = None
        self._stopped = False
        self._done, self._planned, self._problem = 0, 0, ""

    def start(self) -> None:
        """Start, unless it runs or there is no report."""
        folder = self._reports.folder
        with self._lock:
            if self.running or folder is None:
                return
            self._done, self._planned, self._problem, self._stopped = 0, 0, "", False
            self._thread = threading.Thread(target=self._verify, args=(folder,), name="verify", daemon=True)
            self._thread.start()

    @property
    def running(self) -> bool:
        """Whether the plant is being varied."""
        return self._thread is not None and self._thread.is_alive()

    def stop(self) -> None:
        """End the runs; those that are done count."""
        self._stopped = True

    def close(self) -> None:
        """End the runs, and wait until what they say is kept."""
        self.stop()
        if self._thread is not None:
            self._thread.join(_PATIENCE)

    def judge(self, run: int, seed: int, best: str, acceptable: bool) -> None:
        """Keep a person's verdict on one of the worst runs.

        Args:
            run: Its number, from 0.
            seed: Its seed.
            best: Digest of the tuning that was verified.
            acceptable: The verdict.

        Raises:
            StaleError: If another tuning was verified, or the same one again.
        """
        with self._lock:
            folder = self._reports.folder
            said = None if folder is None else verification.said.Verified.read(folder)
            known = [] if said is None else [(each.seed, said.best) for each in said.worst]
            if folder is None or known[run : run + 1] != [(seed, best)]:
                raise StaleError("the result was verified again since you looked")
            report.verifying.judge(folder, run, acceptable=acceptable)

    def view(self) -> dict[str, Any]:
        """Return how far it is, and what came of it, or why that is not known."""
        folder = self._reports.folder
        best = None if folder is None or self.running else folder / verification.said.BEST
        found = "" if best is None else report.export.verified_beside(best)
        return {
            "running": self.running,
            "runs": verification.varied_runs.RUNS,
            "done": self._done,
            "planned": self._planned,
            "problem": self._problem or (found if isinstance(found, str) else ""),
            "said": None if folder is None or isinstance(found, str) else _view(found, folder),
        }

    def _verify(self, folder: Path) -> None:
        try:
            said = report.verifying.verify_best(folder / verification.said.BEST, progress=self._progress)
            if report.verifying.written_beside(said, folder):
                self._problem = f"Only {said.made} runs: an earlier verification has more and stays."
        except Exception as error:
            _, self._problem, _ = explain(error)
        except SystemExit as error:
            self._problem = f"the code of the scenario called exit: {error}"

    def _progress(self, done: int, planned: int | None) -> None:
        self._done, self._planned = done, planned or 0
        if self._stopped:
            raise KeyboardInterrupt  # which a verification takes as its early end


def _view(said: "verification.said.Verified", folder: Path) -> dict[str, Any]:
    """Return what a verification says, for the page; pictures are in a folder."""
    return {
        "best": said.best,
        "verdict": said.verdict,
        "statement": said.statement,
        "limits": said.limits_kept,
        "lines": "\n".join(said.lines),
        "margins": said.margins_kept,
        "advice": [*said.misses, *said.advice],
        "basis": said.basis,
        **report.write.verified_tables(said),
        "effects": list(said.hurting),
        "worst": [
            {
                "words": each.words,
                "values": each.text,
                "seed": each.seed,
                "verdict": each.verdict,
                "picture": f"/report/{name}" if (folder / name).is_file() else "",  # it may not be drawn
            }
            for each, name in zip(said.worst, map(report.verifying.picture, count()), strict=False)
        ],
    }


# --- Handle the requests of the page's script.

VIEWS: Mapping[str, Callable[[Interview], Any]] = MappingProxyType(
    {"brief": brief_view, "history": history_view, "status": status_view, "simulated": map_view}
)
"""Branches of the view that follow from the interview alone."""
_TABS = 100  # number of pages that wait for a change at the same time; more take turns
_SLICE, _PAUSE = 0.2, 0.01
"""Seconds that a page waits in a row, and between two waits: a closed interview returns at once."""
_BLIND = {"blind": bit}
_RECORD = {"index": digits, "unsafe": bit, "again": bit, "theta": numbers, **_BLIND}


@dataclass(frozen=True, slots=True)
class Patience:
    """How long a page may wait for a response, in seconds."""

    poll: float = 10.0  # longest wait for a change
    after_answer: float = 1.0  # longest wait for the next question, which is often ready sooner


@dataclass(frozen=True, slots=True)
class Api:
    """Handlers of the JSON addresses. Everything that uses the interview runs in a thread."""

    interview: Interview  # interview to answer
    reports: Reports  # location of its report, known at the end
    closed: threading.Event  # event to set when the person closes the window
    # Function to call whenever a page asks for the current state; its argument says whether the page waits
    # for a change
    seen: Callable[[bool], None]
    patience: Patience = field(default_factory=Patience)  # how long pages may wait
    again: str = ""  # command that resumes the study
    command: str = ""  # command that repeats the study from the start
    remarks: Sequence[str] = ()  # what is no longer as it was when the study was begun
    # Event to set when no page may wait any more
    stopping: threading.Event = field(default_factory=threading.Event)
    # What limits the pages that wait: theirs are not the threads of answers
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
                status, words, kind = explain(error)
                return error_response(status, words, kind, await self._now_if_stale(request, error))

        return handler

    async def now(self, request: Request) -> Response:
        """Return the current state; with `after`, wait until its version differs from that."""
        query = _query(request, {"after": digits, **_BLIND})
        after = query.get("after")
        self.seen(after is not None)
        if after is not None and (await run_in_threadpool(self.interview.now)).version == after:
            await self._wait_for_change(after, self.patience.poll)
            self.seen(True)
        return await self._show_now(query)

    async def show_answered(self, request: Request) -> Response:
        """Return an answered question as it was shown."""
        query = _query(request, _BLIND)
        try:
            answer = number_of_answer("answer", request.path_params["answer"])
            return as_json(await run_in_threadpool(self._asked, answer, query.get("blind", False)))
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
        return await _respond(partial(look_view, self.interview, query["theta"]))

    async def act(self, request: Request, name: str) -> Response:
        """Do the action `name`, whose fields are the JSON body."""
        query = _query(request, _BLIND)
        return await self._do(query, await _body(request, SENT[name]))

    async def record(self, request: Request) -> Response:
        """Save the record of an experiment that the person ran."""
        return await self._do(*await _record(request))

    async def preview(self, request: Request) -> Response:
        """Return what would be saved of a record, with its curves."""
        _, record = await _record(request)
        return await _respond(partial(preview_view, self.interview, record))

    async def get_view(self, request: Request, view: Callable[[], Any]) -> Response:
        """Return what a function returns that is no branch of the interview's view."""
        _query(request, _BLIND)
        return await _respond(view)

    async def call(
        self, request: Request, do: Callable[..., None], kind: type[Struct], view: Callable[[], Any]
    ) -> Response:
        """Call a function with a body of this kind, and return what `view` returns then."""
        await run_in_threadpool(partial(do, **msgspec.structs.asdict(await _body(request, kind))))
        return await self.get_view(request, view)

    async def close(self, request: Request) -> Response:
        """Close the window after sending this response."""
        query = _query(request, _BLIND)
        await _body(request, Nothing)
        response = await self._show_now(query)
        response.background = BackgroundTask(self.closed.set)
        return response

    async def _now_if_stale(self, request: Request, error: Exception) -> bytes:
        """Return NOW if the request was stale, null after any other error."""
        if not isinstance(error, StaleError):
            return b"null"
        try:
            return bytes((await self._show_now(_query(request, _RECORD))).body)
        except Exception as second:
            explain(second)
            return b"null"

    async def _show_now(self, query: dict[str, Any]) -> Response:
        return as_json(await run_in_threadpool(self._now_as_json, query.get("blind", False)))

    def _now_as_json(self, blind: bool) -> bytes:
        """Return NOW, made once per version: an answer must not wait for other tabs."""
        report = self.reports.folder
        view = partial(
            now_view,
            self.interview,
            blind=blind,
            again=self.again,
            command=self.command,
            remarks=self.remarks,
            report=report,
            seen=self._seen,
        )
        with self._lock:
            return self._make_once(blind, (self.interview.now().version, report), view)

    def _view(self, name: str) -> bytes:
        with self._drawing:
            return self._make_once(name, self.interview.now().version, partial(VIEWS[name], self.interview))

    def _asked(self, answer: int, blind: bool) -> bytes:
        with self._lock:  # all threads share `_seen`
            view = asked_view(self.interview, answer, blind=blind, seen=self._seen)
        return to_json(view)

    def _make_once(self, name: object, key: object, view: Callable[[], Any]) -> bytes:
        """Return a view as JSON, made again only if `key` has changed."""
        kept = self._kept.get(name)
        if kept is None or kept[0] != key:
            kept = self._kept[name] = (key, to_json(view()))
        return kept[1]

    async def _do(self, query: dict[str, Any], action: actions.Action) -> Response:
        """Take an action, then return the next question if it is ready soon."""
        now = await run_in_threadpool(self.interview.do, action)
        end = anyio.current_time() + self.patience.after_answer
        while now.phase is Phase.RUNNING and anyio.current_time() < end:
            await self._wait_for_change(now.version, end - anyio.current_time())
            now = await run_in_threadpool(self.interview.now)
        return await self._show_now(query)

    async def _wait_for_change(self, version: int, timeout: float) -> None:
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


async def _respond(view: Callable[[], Any]) -> Response:
    return as_json(await run_in_threadpool(lambda: to_json(view())))


def _query(request: Request, fields: dict[str, Any]) -> dict[str, Any]:
    return read_query(request.scope["query_string"], fields)


async def _body(request: Request, kind: type[Body]) -> Body:
    if not _has_type(request, "application/json"):
        raise HTTPException(415, "The request must be JSON.")
    return read_json(await request.body(), kind)


async def _record(request: Request) -> tuple[dict[str, Any], actions.Record]:
    """Return the parameters and the record of a request that contains a record."""
    query = _query(request, _RECORD)
    if not _has_type(request, "text/csv"):
        raise HTTPException(415, "The record must be a CSV, Parquet or Excel file, sent as text/csv.")
    if "index" not in query:
        raise MalformedError("The request does not say which experiment the record belongs to.")
    unsafe, again = query.get("unsafe", False), query.get("again", False)
    return query, actions.Record(query["index"], await request.body(), unsafe, query.get("theta"), again)


def _has_type(request: Request, media_type: str) -> bool:
    return request.headers.get("content-type", "").partition(";")[0].strip().lower() == media_type
