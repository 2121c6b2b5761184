"""Malformed requests change nothing, and nothing breaks; each is malformed by construction."""

import asyncio
import json
from dataclasses import dataclass, replace
from urllib.parse import quote

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from support.windows import COOKIE, HOST, ORIGIN, TOKEN

SECRET = b"a secret outside of every folder"


@dataclass(frozen=True)
class Request:
    """What goes over the wire."""

    method: str
    path: str
    body: bytes = b""
    query: bytes = b""
    host: bytes = HOST.encode()
    origin: bytes = ORIGIN.encode()
    cookie: bytes = COOKIE.encode()
    kind: bytes = b"application/json"
    more: tuple[tuple[bytes, bytes], ...] = ()


BODIES = {
    "answer": {"question": 7, "choice": "left", "comment": "", "blind": False},
    "mark": {"question": 7, "side": "left", "mark": "unsafe", "on": True},
    "undo": {"version": 99},
    "retract": {"answer": 1},
    "repeat": {},
    "ask_for": {"theta": [0.5, 21.0, 1.0]},
    "pace": {"questions": 3},
    "retry": {},
    "fail": {"index": 0, "reason": "broken"},
    "finish": {},
    "go_on": {"more": 5},
    "close": {},
}
WELL = [Request("POST", f"/api/{name}", json.dumps(body).encode()) for name, body in BODIES.items()]
JUNK = st.one_of(
    st.binary(max_size=40),
    st.text(max_size=20).map(lambda text: text.encode("utf-8", "surrogatepass")),
    st.sampled_from(
        [b"..", b"../", b"%2e%2e%2f", b"..%2f..%2fsecret.json", b"%00", b"\0", b"\xff\xfe", b"//",
         b"%252e%252e/", b"..\\", b"~root", b"null", b"NaN", b"-1", b"1e999", b"9" * 5000]
    ),
)  # fmt: skip
VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=10)
    | st.sampled_from([10**400, -(10**30), 2**63, "\ud800", "a\0", "left\n", "x" * 20_000]),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3)
    ),
    max_leaves=6,
)  # fmt: skip


def fits(name, value):
    """Whether a page could send `value` in the field `name`, seen generously."""
    if name in ("comment", "reason"):
        return isinstance(value, str) and len(value) <= 10_000
    if name in ("blind", "on"):
        return isinstance(value, bool)
    if name in ("choice", "side", "mark"):
        return value in ("left", "right", "same", "cannot tell", "unsafe", "good enough")
    if name == "theta":
        return isinstance(value, list) and all(type(v) in (int, float) for v in value)
    return type(value) is int and value >= 0


@st.composite
def broken_objects(draw):
    """A field too many, missing, or of another kind."""
    name = draw(st.sampled_from(sorted(BODIES)))
    body = dict(BODIES[name])
    how = draw(st.sampled_from(["more", "missing", "other"] if body else ["more"]))
    key = draw(st.sampled_from(sorted(body))) if body else ""
    if how == "more":
        body[draw(st.text(max_size=8).filter(lambda k: k not in BODIES[name]))] = draw(VALUES)
    elif how == "missing":
        del body[key]
    else:
        body[key] = draw(VALUES.filter(lambda value: not fits(key, value)))
    return Request("POST", f"/api/{name}", json.dumps(body).encode())


@st.composite
def broken_bytes(draw):
    """No JSON object: cut off, mixed up, nested without end, or anything."""
    well = draw(st.sampled_from(WELL))
    cut = well.body[: draw(st.integers(0, len(well.body) - 1))]
    place = draw(st.integers(0, len(well.body)))
    mixed = well.body[:place] + draw(JUNK) + well.body[place:]
    deep = draw(st.sampled_from([b"[", b'{"a":', b'{"question":['])) * draw(st.integers(1, 5000))
    body = draw(st.sampled_from([cut, mixed, deep]) | st.binary(max_size=80) | VALUES.map(as_bytes))
    return replace(well, body=body if not is_object(body) else body + b"]")


def as_bytes(value):
    return json.dumps(value).encode()


def is_object(body):
    try:
        return isinstance(json.loads(body), dict)
    except (ValueError, RecursionError):
        return False


@st.composite
def strangers(draw):
    """A valid request with a wrong host, origin, cookie or content type."""
    well = draw(st.sampled_from(WELL))
    field = draw(st.sampled_from(["host", "origin", "cookie", "kind"]))
    junk = draw(JUNK).replace(b";", b"")  # which would set a cookie apart
    value = b"x" + junk + (getattr(well, field) if draw(st.booleans()) else b"")
    return replace(well, **{field: value})


@st.composite
def wrong_addresses(draw):
    """Paths and queries that do not exist, and methods that do not fit."""
    well = draw(st.sampled_from(WELL))
    junk = draw(JUNK)
    start = draw(st.sampled_from(
        ["/", "/static/", "/report/", "/open/", "/api/", "/api/history/", "/api/now/", "//", ""]
    ))  # fmt: skip
    path = start + "x" + junk.decode("utf-8", "replace")
    method = draw(st.sampled_from(["PUT", "DELETE", "PATCH", "TRACE", "", "post"]))
    return draw(st.sampled_from([
        replace(well, path=path),
        replace(well, query=b"x=" + junk),
        replace(well, query=b"blind=1&blind=" + junk),
        replace(well, path="/api/record", query=b"index=0&unsafe=x" + junk, kind=b"text/csv"),
        replace(well, method=method),
        Request("GET", start + junk.decode("utf-8", "replace"), query=junk),
        Request("GET", start + quote(junk), query=b"after=" + junk + b"&blind=1"),
        Request("HEAD", path, query=junk),
        Request("GET", "/static/main.js", more=((b"accept-encoding", junk), (b"range", junk),
                                                (b"if-none-match", junk))),
        Request("GET", well.path, body=well.body),
    ]))  # fmt: skip


REQUESTS = broken_objects() | broken_bytes() | strangers() | wrong_addresses()


async def ask(app, request):
    """Status and body of the response."""
    scope = {
        "type": "http", "http_version": "1.1", "method": request.method, "path": request.path,
        "raw_path": quote(request.path, errors="replace").encode(), "root_path": "",
        "query_string": request.query, "scheme": "http", "server": ("127.0.0.1", 1),
        "client": ("127.0.0.1", 2),
        "headers": [
            (b"host", request.host), (b"origin", request.origin), (b"cookie", request.cookie),
            (b"content-type", request.kind), *request.more,
        ],
    }  # fmt: skip
    sent, parts = [], [request.body[:10], request.body[10:]]

    async def receive():
        return {"type": "http.request", "body": parts.pop(0), "more_body": bool(parts)}

    async def send(message):
        sent.append(message)

    await app(scope, receive, send)
    return sent[0]["status"], b"".join(message.get("body", b"") for message in sent[1:])


@pytest.mark.parametrize(
    "examples", [300, pytest.param(10_000, marks=pytest.mark.campaign)], ids=str
)
def test_malformed_requests_change_nothing_and_break_nothing(room, tmp_path, examples):
    (tmp_path / "secret.json").write_bytes(SECRET)
    folder = tmp_path / "report"
    folder.mkdir()
    room.reports.put(folder)
    before = (room.interview.now().version, room.events)
    statuses = {}

    with asyncio.Runner() as runner:

        @settings(
            max_examples=examples, deadline=None, database=None,
            suppress_health_check=list(HealthCheck),
        )  # fmt: skip
        @given(request=REQUESTS)
        def fuzz(request):
            status, body = runner.run(ask(room.app, request))
            statuses[status] = statuses.get(status, 0) + 1
            assert status < 500
            assert status >= 400 or request.method in ("GET", "HEAD")
            assert SECRET not in body
            assert TOKEN.encode() not in body
            assert (room.interview.now().version, room.events) == before
            assert not room.closed.is_set()

        fuzz()
    assert {400, 401, 403, 404, 405, 415} <= statuses.keys()


def test_the_requests_are_malformed_by_one_thing_only(room):
    """Otherwise the fuzzing would prove nothing."""
    with asyncio.Runner() as runner:
        by_path = {request.path: runner.run(ask(room.app, request))[0] for request in WELL}
    assert by_path.pop("/api/close") == 200
    assert set(by_path.values()) <= {200, 409}
    assert by_path["/api/finish"] == 200
