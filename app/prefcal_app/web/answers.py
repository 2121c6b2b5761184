"""Build the server's responses: JSON, and errors as sentences for the person."""

import json
import logging
from collections.abc import Awaitable, Callable
from typing import Any

import msgspec
import numpy as np
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response

from prefcal_env.errors import PrefcalError, RecordError, StaleError, StudyError

from .bodies import MalformedError

Handler = Callable[[Request], Awaitable[Response]]

_log = logging.getLogger(__name__)
_KINDS: tuple[tuple[type[Exception], int, str], ...] = (
    (MalformedError, 400, "refused"),
    (StaleError, 409, "stale"),
    (RecordError, 422, "record"),
    (StudyError, 507, "study"),
    (PrefcalError, 422, "refused"),
)
"""Error, status and kind; the first match counts."""
_WORDS = {404: "There is nothing at this address.", 405: "This address does not accept that kind of request."}


def encoded(view: Any) -> bytes:
    """Return JSON in UTF-8; NaN and infinite numbers become null."""
    return msgspec.json.encode(view, enc_hook=_plain)


def _plain(number: np.generic) -> Any:
    return number.item()


def as_json(content: bytes, status: int = 200) -> Response:
    """Return a response with JSON that is already encoded."""
    return Response(content, status, media_type="application/json")


def error_response(status: int, error: str, kind: str, now: bytes = b"null") -> Response:
    """Return an error: a sentence for the person, its kind and the current state for the script."""
    head = json.dumps({"error": error, "kind": kind})[:-1].encode()
    return as_json(head + b', "now": ' + now + b"}", status)


def refused(error: Exception) -> tuple[int, str, str]:
    """Return status, sentence and kind of an error.

    Any error that is not one of prefcal's own is a bug: it is logged and reported to the person.
    """
    for type_, status, kind in _KINDS:
        if isinstance(error, type_):
            return status, str(error), kind
    _log.error("a request failed", exc_info=error)
    words = f"prefcal failed because of a bug in it ({type(error).__name__}: {error})."
    return 500, words, "refused"


async def http_error(request: Request, error: Exception) -> Response:
    """Return the response to an address or a method that does not exist."""
    assert isinstance(error, HTTPException)
    words = _WORDS.get(error.status_code, str(error.detail))
    if request.scope["path"].startswith("/api/"):
        return error_response(error.status_code, words, "refused")
    return PlainTextResponse(words, error.status_code)
