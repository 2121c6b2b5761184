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
    "choose": {"theta": [0.5, 21.0, 1.0], "best": 0},
    "pace": {"questions": 3},
    "retry": {},
    "fail": {"index": 0, "reason": "broken"},
    "finish": {},
    "go_on": {"more": 5},
    "close": {},
}
WELL = [Request("POST", f"/api/{name}", json.dumps(body).encode()) for name, body in BODIES.items()]
ODD = b".. ../ %2e%2e%2f ..%2f..%2fsecret.json %00 \0 \xff\xfe // %252e%252e/ ..\\ ~root null NaN -1 1e999"
JUNK = st.one_of(
    st.binary(max_size=40),
    st.text(max_size=20).map(lambda text: text.encode("utf-8", "surrogatepass")),
    st.sampled_from([*ODD.split(), b"9" * 5000]),
)
VALUES = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.text(max_size=10)
    | st.sampled_from([10**400, -(10**30), 2**63, "\ud800", "a\0", "left\n", "x" * 20_000]),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=6,
)
ALL = {  # what no field of a page ever holds
    name: VALUES.filter(lambda value: not isinstance(value, str | bool | int | float | list))
    for name in sorted({key for body in BODIES.values() for key in body})
}


@st.composite
def broken_bodies(draw):
    """A field too many, missing or of another kind; cut off, mixed up, nested, or anything."""
    well = draw(st.sampled_from(WELL))
    body, place = json.loads(well.body), draw(st.integers(0, len(well.body)))
    key = draw(st.sampled_from(sorted(body))) if body else "more"
    rest = {name: value for name, value in body.items() if name != key}
    deep = draw(st.sampled_from([b"[", b'{"a":', b'{"question":['])) * draw(st.integers(1, 5000))
    broken = [
        json.dumps(body | {f"{key}x": draw(VALUES)}).encode(),
        json.dumps(rest if body else {"more": 1}).encode(),
        json.dumps(body | {key: draw(ALL.get(key, VALUES))}).encode(),
        well.body[: max(place - 1, 0)],
        well.body[:place] + draw(JUNK) + well.body[place:] + b"]",
        deep,
        draw(st.binary(max_size=80)) + b"]",
    ]
    return replace(well, body=draw(st.sampled_from(broken)))


@st.composite
def strangers(draw):
    """A valid request with a wrong host, origin, cookie or content type."""
    well = draw(st.sampled_from(WELL))
    field = draw(st.sampled_from(["host", "origin", "cookie", "kind"]))
    junk = draw(JUNK).replace(b";", b"")  # which would set a cookie apart
    return replace(well, **{field: b"x" + junk + draw(st.sampled_from([b"", getattr(well, field)]))})


@st.composite
def wrong_addresses(draw):
    """Paths and queries that do not exist, and methods that do not fit."""
    well = draw(st.sampled_from(WELL))
    junk = draw(JUNK)
    start = draw(
        st.sampled_from(
            ["/", "/static/", "/report/", "/open/", "/api/", "/api/history/", "/api/now/", "//", ""]
        )
    )
    text = junk.decode("utf-8", "replace")
    return draw(
        st.sampled_from(
            [
                replace(well, path=f"{start}x{text}"),
                replace(well, query=b"x=" + junk),
                replace(well, query=b"blind=1&blind=" + junk),
                replace(well, path="/api/record", query=b"index=0&unsafe=x" + junk, kind=b"text/csv"),
                replace(well, method=draw(st.sampled_from(["PUT", "DELETE", "TRACE", "", "post"]))),
                Request("GET", start + text, query=junk),
                Request("GET", start + quote(junk), query=b"after=" + junk + b"&blind=1"),
                Request("HEAD", f"{start}x{text}", query=junk),
                Request("GET", "/static/main.js", more=((b"range", junk), (b"if-none-match", junk))),
                Request("GET", well.path, body=well.body),
            ]
        )
    )


REQUESTS = broken_bodies() | strangers() | wrong_addresses()


async def ask(app, request):
    """Status and body of the response."""
    scope = {
        "type": "http",
        "http_version": "1.1",
        "method": request.method,
        "path": request.path,
        "raw_path": quote(request.path, errors="replace").encode(),
        "root_path": "",
        "query_string": request.query,
        "scheme": "http",
        "server": ("127.0.0.1", 1),
        "client": ("127.0.0.1", 2),
        "headers": [
            (b"host", request.host),
            (b"origin", request.origin),
            (b"cookie", request.cookie),
            (b"content-type", request.kind),
            *request.more,
        ],
    }
    sent, parts = [], [request.body[:10], request.body[10:]]

    async def receive():
        return {"type": "http.request", "body": parts.pop(0), "more_body": bool(parts)}

    async def send(message):
        sent.append(message)

    await app(scope, receive, send)
    return sent[0]["status"], b"".join(message.get("body", b"") for message in sent[1:])


@pytest.mark.parametrize("examples", [300, pytest.param(10_000, marks=pytest.mark.campaign)], ids=str)
def test_malformed_requests_change_nothing_and_break_nothing(room, tmp_path, examples):
    (tmp_path / "secret.json").write_bytes(SECRET)
    folder = tmp_path / "report"
    folder.mkdir()
    room.reports.folder = folder
    before = (room.interview.now().version, room.events)
    statuses = {}

    with asyncio.Runner() as runner:

        @settings(
            max_examples=examples, deadline=None, database=None, suppress_health_check=list(HealthCheck)
        )
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
