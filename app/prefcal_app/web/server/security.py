"""Check every request before a handler sees it, and add security headers to every response."""

import secrets
from collections.abc import Mapping
from dataclasses import dataclass
from http import HTTPStatus
from types import MappingProxyType

import anyio
from starlette.responses import JSONResponse, PlainTextResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from .hosts import Hosts

POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data: blob:; connect-src 'self'; font-src 'self'; base-uri 'none'; "
    "form-action 'self'; frame-ancestors 'none'"
)
"""Content security policy. Plotly adds inline styles, hence 'unsafe-inline'."""
REPORT_POLICY = (
    "sandbox allow-popups; default-src 'none'; style-src 'unsafe-inline'; img-src data:; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
"""Content security policy of the report: a sandbox with another origin, without scripts and
network, so that nothing in the report can send requests to this window."""
HEADERS: Mapping[bytes, bytes] = MappingProxyType(
    {
        b"content-security-policy": POLICY.encode(),
        b"x-content-type-options": b"nosniff",
        b"referrer-policy": b"no-referrer",
        b"cross-origin-opener-policy": b"same-origin",
        b"cross-origin-resource-policy": b"same-origin",
        b"x-frame-options": b"DENY",
    }
)
FRAMING = b"http://127.0.0.1:* http://localhost:*"
"""Pages that may show a window in a frame if its owner asks for that: those of this machine."""
LARGEST_HEAD = 32 * 1024
"""Maximum bytes of an address and all headers."""
LARGEST_BODY = 64 * 1024
"""Maximum bytes of a JSON body."""
LARGEST_RECORD = 20 * 1024 * 1024
"""Maximum bytes of a rig's record."""
BODY_SECONDS = 60.0
"""Seconds within which a body must arrive."""
RECORD_PATHS = ("/api/record", "/api/preview")
OPEN_PATH = "/open/"
_METHODS = ("GET", "HEAD", "POST")


@dataclass(frozen=True, slots=True)
class Refusal:
    """A response to a request that no handler sees: status and a sentence for the person."""

    status: int
    error: str
    kind: str = "refused"


NO_COOKIE = Refusal(
    401, "This page belongs to a study: open it with the link that prefcal printed in the terminal."
)


_LATE = Refusal(408, f"This took longer than {BODY_SECONDS:g} s to arrive. Nothing was saved; send it again.")


def too_big(limit: int) -> Refusal:
    """Return the refusal of a body of more than `limit` bytes."""
    size = f"{limit // 1024} KiB" if limit < 1024**2 else f"{limit // 1024**2} MiB"
    return Refusal(413, f"This is too big: the limit is {size}.", "limit")


class Guard:
    """Middleware that refuses foreign Hosts and Origins, missing cookies and unbounded bodies.

    It reads each body up to the limit, also if it comes in chunks; the application gets it in one
    piece.

    Args:
        app: Application to protect.
        token: Secret of the link and of the cookie.
        hosts: Accepted host names.
        framed: Whether pages of this machine, such as a notebook, may show the window in a frame.
    """

    def __init__(self, app: ASGIApp, *, token: str, hosts: Hosts, framed: bool = False) -> None:
        self._app, self._token, self._hosts, self._framed = app, token, hosts, framed

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, or refuse it."""
        if scope["type"] == "lifespan":
            return await self._app(scope, receive, send)
        if scope["type"] != "http":
            return await send({"type": "websocket.close", "code": 1008})
        send = _with_headers(send, self._framed)
        refusal = self._refuse(scope)
        body: bytes | Refusal | None = b""
        if refusal is None and scope["method"] == "POST":
            limit = LARGEST_RECORD if scope["path"] in RECORD_PATHS else LARGEST_BODY
            body = _LATE
            with anyio.move_on_after(BODY_SECONDS):
                body = await _body(scope, receive, limit)
            if body is None:
                return None  # the client disconnected
            refusal = body if isinstance(body, Refusal) else None
        if refusal is not None:
            return await _answer(scope, receive, send, refusal)
        assert isinstance(body, bytes)
        return await self._app(scope, _replayed(body, receive), send)

    def _refuse(self, scope: Scope) -> Refusal | None:
        if scope["method"] not in _METHODS:
            return Refusal(405, "Only GET, HEAD and POST are supported.")
        if _head(scope) > LARGEST_HEAD:
            return Refusal(431, "The address or the headers are too long.", "limit")
        if not scope["query_string"].isascii():
            return Refusal(400, "The address has parameters that cannot be read.")
        hosts, origins = _values(scope, b"host"), _values(scope, b"origin")
        if len(hosts) != 1 or not self._hosts.allow(hosts[0]):
            return Refusal(403, "The request was sent to a host name that is not the window's.")
        if origins not in ([], [f"http://{hosts[0]}"]):
            return Refusal(403, "The request comes from another page.")
        if scope["method"] == "POST" and not origins:
            return Refusal(403, "The request does not say which page it comes from.")
        if scope["path"].startswith(OPEN_PATH):
            return None  # its handler compares the token
        cookies = _cookies(scope, cookie_name(self._hosts.port))
        # Any of them: another program on this machine may have set a cookie of the same name.
        return None if any(same(c, self._token) for c in cookies) else NO_COOKIE


def cookie_name(port: int) -> str:
    """Return the name of a window's cookie. Ports share cookies, so the name has the port."""
    return f"prefcal_{port}"


def cookie(token: str, port: int) -> str:
    """Return the Set-Cookie header of a window."""
    return f"{cookie_name(port)}={token}; HttpOnly; SameSite=Strict; Path=/"


def same(given: str, token: str) -> bool:
    """Return whether both are equal, in constant time."""
    return secrets.compare_digest(given.encode("utf-8", "replace"), token.encode())


def _replayed(body: bytes, receive: Receive) -> Receive:
    """Return a `receive` for a body that was already read, then any later messages."""
    messages = [{"type": "http.request", "body": body, "more_body": False}]

    async def replay() -> Message:
        return messages.pop() if messages else await receive()

    return replay


def _head(scope: Scope) -> int:
    """Return the number of bytes of address and headers."""
    headers = sum(len(key) + len(value) for key, value in scope["headers"])
    return headers + len(scope["path"]) + len(scope["query_string"])


def _values(scope: Scope, name: bytes) -> list[str]:
    return [value.decode("latin-1") for key, value in scope["headers"] if key.lower() == name]


def _cookies(scope: Scope, name: str) -> list[str]:
    pairs = [pair.partition("=") for text in _values(scope, b"cookie") for pair in text.split(";")]
    return [value.strip() for key, _, value in pairs if key.strip() == name]


async def _body(scope: Scope, receive: Receive, limit: int) -> bytes | Refusal | None:
    """Return the body, a refusal if it exceeds `limit`, or None if the client disconnected."""
    for length in _values(scope, b"content-length"):
        if not (length.isascii() and length.isdigit() and len(length) < 20):
            return Refusal(400, "The length of the request is not a number.")
        if int(length) > limit:
            return too_big(limit)
    parts, size, more = [], 0, True
    while more:
        message = await receive()
        if message["type"] != "http.request":
            return None
        parts.append(message.get("body", b""))
        size += len(parts[-1])
        if size > limit:
            return too_big(limit)
        more = message.get("more_body", False)
    return b"".join(parts)


async def _answer(scope: Scope, receive: Receive, send: Send, refusal: Refusal) -> None:
    """Send a refusal: JSON to the page's script, a plain sentence to a person."""
    response: Response = PlainTextResponse(refusal.error, refusal.status)
    if scope["path"].startswith("/api/"):
        told = {"error": refusal.error, "kind": refusal.kind, "now": None}
        response = JSONResponse(told, refusal.status)
    await response(scope, receive, send)


def _framed(headers: Mapping[bytes, bytes]) -> dict[bytes, bytes]:
    """Return the headers of a window that pages of this machine may frame."""
    kept = {name: value for name, value in headers.items() if name != b"x-frame-options"}
    policy = kept[b"content-security-policy"]
    forbidden, allowed = b"frame-ancestors 'none'", b"frame-ancestors " + FRAMING
    return kept | {b"content-security-policy": policy.replace(forbidden, allowed)}


def _with_headers(send: Send, framed: bool) -> Send:
    standard = _framed(HEADERS) if framed else HEADERS

    async def sending(message: Message) -> None:
        if message["type"] == "http.response.start":
            policy = b"content-security-policy"  # a handler may set a stricter one
            own = [(k, v) for k, v in message["headers"] if k.lower() == policy]
            given = [(k, v) for k, v in message["headers"] if k.lower() not in HEADERS]
            if not any(key.lower() == b"cache-control" for key, _ in given):
                given.append((b"cache-control", b"no-store"))
            if message["status"] >= HTTPStatus.BAD_REQUEST:
                # Otherwise the server would keep reading the rest of an endless body.
                given = [(k, v) for k, v in given if k.lower() != b"connection"]
                given.append((b"connection", b"close"))
            fixed = [(k, v) for k, v in standard.items() if not (own and k == policy)]
            message = {**message, "headers": [*given, *own, *fixed]}
        await send(message)

    return sending
