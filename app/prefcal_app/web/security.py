"""Who may talk to the page: hosts, cookies, connections, and the files that it may load."""

import asyncio
import ipaddress
import secrets
import socket
from collections.abc import Mapping
from dataclasses import dataclass
from hashlib import sha256
from http import HTTPStatus
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path
from types import MappingProxyType
from typing import Any

import anyio
import h11
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import JSONResponse, PlainTextResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from uvicorn.protocols.http.h11_impl import H11Protocol

# --- Hold the page's files in memory; no other file can be requested.

_STATIC = files("prefcal_app.web") / "static"
_PLOTLY = "plotly-basic.min.js"
_TYPES: Mapping[str, str] = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".svg": "image/svg+xml",
}
"""Types by suffix. Those of the system are not used: on some, scripts are plain text."""


class Assets:
    """The files of the folder `static`, and plotly.js, which has a folder of its own there.

    Args:
        folder: Folder of the files; the package's own if None.
    """

    def __init__(self, folder: Traversable | None = None) -> None:
        own = _STATIC if folder is None else folder
        found = list(own.iterdir()) if own.is_dir() else []
        # Compare with existing names instead of joining paths: no name can leave the folder.
        wanted = [file for file in found if file.is_file() and Path(file.name).suffix in _TYPES]
        self._contents = {file.name: file.read_bytes() for file in wanted}
        self._contents[_PLOTLY] = (_STATIC / "plotly" / _PLOTLY).read_bytes()
        self._tags = {name: f'"{sha256(it).hexdigest()[:20]}"' for name, it in self._contents.items()}

    def response(self, name: str, request: Request) -> Response:
        """Return the file called `name`, or that the browser has it already.

        Raises:
            HTTPException: If there is no such file.
        """
        if name not in self._contents:
            raise HTTPException(404)
        # Browsers ask each time whether it has changed.
        headers = {"cache-control": "no-cache", "etag": self._tags[name]}
        if self._tags[name] in request.headers.get("if-none-match", ""):
            return Response(status_code=304, headers=headers)
        media_type = _TYPES[Path(name).suffix]
        return Response(self._contents[name], headers=headers, media_type=media_type)


# --- Decide which host names may reach the window, and warn about addresses that others can reach.

LOOPBACK_NAMES = ("127.0.0.1", "localhost", "[::1]")


@dataclass(frozen=True, slots=True)
class Hosts:
    """Accepted values of a Host header.

    This stops DNS rebinding: a foreign page whose name resolves to this machine still sends its
    own name, which is refused.
    """

    names: frozenset[str]  # names and addresses in lower case, without a port; IPv6 in brackets
    port: int  # port of the window
    # Whether to accept every IP address, for a window that listens on all of them. No foreign page can have
    # an IP address of this machine as its name.
    any_address: bool = False

    @classmethod
    def of(cls, address: str, port: int) -> "Hosts":
        """Return the hosts of a window that listens on the IP address `address`."""
        ip = ipaddress.ip_address(address)
        if ip.is_loopback:
            return cls(frozenset({*LOOPBACK_NAMES, in_link(address)}), port)
        own = socket.gethostname().lower()
        names = {*LOOPBACK_NAMES, in_link(address), own, f"{own}.local"}
        return cls(frozenset(names), port, ip.is_unspecified)

    def allow(self, host: str) -> bool:
        """Return whether `host`, the value of a Host header, is accepted."""
        name, port = _split(host.lower())
        if port != self.port:
            return False
        return name in self.names or (self.any_address and _is_address(name))


def in_link(address: str) -> str:
    """Return an IP address as written in links; a wildcard becomes the loopback address."""
    ip = ipaddress.ip_address(address.partition("%")[0])
    if ip.is_unspecified:
        ip = ipaddress.ip_address("::1" if ip.version == 6 else "127.0.0.1")
    return f"[{ip}]" if ip.version == 6 else str(ip)


def seen_from_outside(address: str) -> str:
    """Return this machine's address for other machines, as written in links.

    Empty if the address of `in_link` works for them too, or if they cannot reach the window.

    Args:
        address: IP address that the window listens on.
    """
    ip = ipaddress.ip_address(address.partition("%")[0])
    if not ip.is_unspecified:
        return ""
    probe = ("2001:db8::1", 9) if ip.version == 6 else ("192.0.2.1", 9)  # reserved, unused
    family = socket.AF_INET6 if ip.version == 6 else socket.AF_INET
    try:
        with socket.socket(family, socket.SOCK_DGRAM) as udp:
            udp.connect(probe)  # sends nothing, but chooses the local address
            own = str(udp.getsockname()[0])
    except OSError:
        return socket.gethostname().lower()  # no route: a name that `Hosts` allows
    return in_link(own)


def warning(address: str) -> str:
    """Return the privacy warning for an IP address to listen on; empty for a loopback address."""
    if ipaddress.ip_address(address.partition("%")[0]).is_loopback:
        return ""
    return (
        f"The window listens on {address}, beyond this machine: everybody on that network who "
        "has the link can see this study and answer its questions. The traffic is not encrypted: "
        "anybody who can monitor the network can read it, including the link."
    )


def _split(host: str) -> tuple[str, int]:
    """Return name and port of a Host header; port -1 if it is not a number."""
    name, colon, port = host.rpartition(":")
    if not colon or port.endswith("]"):
        return host, 80
    return name, int(port) if port.isascii() and port.isdigit() and len(port) <= 5 else -1


def _is_address(name: str) -> bool:
    bare = name[1:-1] if name.startswith("[") and name.endswith("]") else name
    try:
        ip = ipaddress.ip_address(bare)
    except ValueError:
        return False
    return (ip.version == 6) == (bare is not name)


# --- Check every request before a handler sees it, and add security headers to every response.

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
LARGEST_HEAD = 32 * 1024  # maximum bytes of an address and all headers
LARGEST_BODY = 64 * 1024  # maximum bytes of a JSON body
LARGEST_RECORD = 20 * 1024 * 1024  # maximum bytes of a rig's record
BODY_SECONDS = 60.0  # seconds within which a body must arrive
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
        token: Secret of the link and of the cookie.
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


def _with_headers(send: Send, framed: bool) -> Send:
    standard = dict(HEADERS)
    if framed:
        del standard[b"x-frame-options"]
        forbidden, allowed = b"frame-ancestors 'none'", b"frame-ancestors " + FRAMING
        standard[b"content-security-policy"] = POLICY.encode().replace(forbidden, allowed)

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


# --- Limit connections that keep the window waiting, in time and in number per peer.

HEAD_SECONDS = 10.0  # seconds within which the address and the headers of a request must arrive
MOST_WAITING = 32  # maximum number of connections per peer without a complete request; browsers open six
_AFTER = 5.0  # extra seconds after `BODY_SECONDS`, for sending the error to the person

_BUSY = (
    b"HTTP/1.1 503 Service Unavailable\r\nRetry-After: 1\r\nConnection: close\r\n"
    b"Content-Type: text/plain\r\nContent-Length: 22\r\n\r\nToo many connections.\n"
)
"""What a connection is told that has to make way for a newer one."""


class Connection(H11Protocol):
    """A uvicorn connection that closes if its request does not arrive.

    Those of a window share `waiting`: by peer, the ones without a complete request. If a peer has too
    many of them, the oldest one is answered with 503 and closes: an honest request arrives at once.
    """

    def __init__(self, *args: Any, waiting: dict[str, dict["Connection", None]], **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self._waiting = waiting
        self._timer: asyncio.TimerHandle | None = None
        self._timed: Any = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Wait for the first request."""
        super().connection_made(transport)
        self._expect()

    def data_received(self, data: bytes) -> None:
        """Process received data, then wait for what is still missing."""
        super().data_received(data)
        self._expect()

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget the connection."""
        self._rest()
        super().connection_lost(exc)

    def _expect(self) -> None:
        """Start the timer of the head or body that is expected now; a running one continues."""
        awaited = self.conn.their_state
        if awaited is self._timed:
            return
        self._rest()
        if awaited not in (h11.IDLE, h11.SEND_BODY):
            return  # the request is complete
        self._timed = awaited
        seconds = HEAD_SECONDS if awaited is h11.IDLE else BODY_SECONDS + _AFTER
        self._timer = self.loop.call_later(seconds, self.drop)
        of_peer = self._waiting.setdefault(self._peer, {})
        of_peer[self] = None
        if len(of_peer) > MOST_WAITING:
            next(iter(of_peer)).make_way()

    def make_way(self) -> None:
        """Close the connection with a last word to the other side: there are too many."""
        self._rest()
        self.transport.write(_BUSY)
        self.transport.close()

    def drop(self) -> None:
        """Close the connection at once."""
        self._rest()
        self.transport.abort()

    def _rest(self) -> None:
        """Stop the timer: nothing is expected."""
        self._timed = None
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        of_peer = self._waiting.get(self._peer, {})
        of_peer.pop(self, None)
        if not of_peer:
            self._waiting.pop(self._peer, None)

    @property
    def _peer(self) -> str:
        return self.client[0] if self.client else ""
