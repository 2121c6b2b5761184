"""Who is let in: names, origins, the cookie; and what every response bears."""

import asyncio

import pytest

from prefcal_app.web.security import LARGEST_BODY, LARGEST_RECORD, POLICY, Hosts, in_link, warning
from support.windows import COOKIE, HOST, ORIGIN, PORT, TOKEN


@pytest.fixture
def room(shared_room):
    """Nothing that is refused may change anything: one room will do."""
    return shared_room


def answer(room, **changes):
    return {"question": room.question(), "choice": "left", "comment": "", "blind": False, **changes}


def untouched(room, ask):
    """The response of `ask`, which must not have recorded anything."""
    version, events = room.interview.now().version, room.events
    response = ask()
    assert (room.interview.now().version, room.events) == (version, events)
    return response


FOREIGN = (
    f"evil.example evil.example:{PORT} 127.0.0.1 127.0.0.1:{PORT + 1} 127.0.0.1.evil.example:{PORT} "
    f"localhost:{PORT}:{PORT} 127.0.0.1:{PORT}x 192.168.0.9:{PORT} evil@127.0.0.1:{PORT} [::2]:{PORT}"
)


@pytest.mark.parametrize("host", [*FOREIGN.split(), "", "127.0.0.1:\u0661"])
def test_a_foreign_name_is_refused_even_with_the_cookie(room, host):
    given = {"cookie": COOKIE, "host": host.encode("utf-8")}
    page = room.page()
    page.headers = given
    assert untouched(room, lambda: page.get("/api/now")).status_code == 403
    assert page.get(f"/open/{TOKEN}").status_code == 403


@pytest.mark.parametrize("host", [HOST, f"localhost:{PORT}", f"[::1]:{PORT}", f"LOCALHOST:{PORT}"])
def test_the_names_of_the_loopback_device_are_ours(room, host):
    assert room.page(host=host, origin=f"http://{host}").get("/api/now").status_code == 200


ORIGINS_OF_OTHERS = (
    f"null http://evil.example https://{HOST} http://127.0.0.1 {ORIGIN}/ http://127.0.0.1:{PORT + 1} "
    f"http://localhost:{PORT} {ORIGIN}.evil.example *"
)


@pytest.mark.parametrize("origin", ORIGINS_OF_OTHERS.split())
def test_a_foreign_origin_is_refused(room, origin):
    page = room.page(origin=origin)
    response = untouched(room, lambda: page.post("/api/answer", json=answer(room)))
    assert response.status_code == 403
    assert "another page" in response.json()["error"]
    assert page.get("/api/now").status_code == 403


def test_a_post_without_an_origin_is_refused(room):
    page = room.page(origin="")
    response = untouched(room, lambda: page.post("/api/answer", json=answer(room)))
    assert response.status_code == 403
    assert page.get("/api/now").status_code == 200


NAME = f"prefcal_{PORT}"
WRONG = (
    f"{NAME}= {NAME}={TOKEN}x {NAME}={TOKEN[:-1]} prefcal_{PORT + 1}={TOKEN} prefcal={TOKEN} {TOKEN} "
    f"x={NAME}={TOKEN} {NAME}={TOKEN.upper()}"
)


@pytest.mark.parametrize("cookie", ["", *WRONG.split()])
@pytest.mark.parametrize("path", ["/", "/api/now", "/static/main.js", "/report/x.png", "/nowhere"])
def test_without_the_cookie_nothing_is_shown_but_a_sentence(room, cookie, path):
    response = room.page(cookie=cookie).get(path)
    assert response.status_code == 401
    assert "link" in response.text


def test_an_answer_without_the_cookie_is_refused(room):
    page = room.page(cookie="")
    response = untouched(room, lambda: page.post("/api/answer", json=answer(room)))
    assert (response.status_code, response.json()["kind"]) == (401, "refused")
    assert response.json()["now"] is None


def test_a_cookie_that_another_program_has_set_beside_ours_does_no_harm(room):
    page = room.page(cookie=f"a=b; prefcal_{PORT}=wrong; {COOKIE}")
    assert page.get("/api/now").status_code == 200


def test_the_link_gives_the_cookie_and_the_page(room):
    response = room.page(cookie="").get(f"/open/{TOKEN}")
    assert response.status_code == 200
    assert response.headers["content-type"].startswith("text/html")
    parts = {part.strip() for part in response.headers["set-cookie"].split(";")}
    assert parts == {f"prefcal_{PORT}={TOKEN}", "HttpOnly", "SameSite=Strict", "Path=/"}


@pytest.mark.parametrize("token", ["wrong", TOKEN + "x", "%C3%A9", "%00", "%ff", "%2e%2e", "the-toke"])
def test_a_wrong_link_is_refused(room, token):
    response = room.page().get(f"/open/{token}")
    assert response.status_code in (401, 404)
    assert "set-cookie" not in response.headers


@pytest.mark.parametrize(
    ("method", "path", "status"),
    [
        *(("GET", path, 200) for path in ("/", f"/open/{TOKEN}", "/api/now", "/static/main.js")),
        *(("GET", path, 404) for path in ("/nowhere", "/api/nowhere")),
        ("GET", "/api/answer", 405),
        ("POST", "/api/answer", 415),
        ("PUT", "/api/answer", 405),
        ("OPTIONS", "/api/answer", 405),
        ("TRACE", "/", 405),
        ("DELETE", "/", 405),
    ],
)
def test_every_response_bears_the_policy_and_is_not_kept(room, method, path, status):
    response = room.page().request(method, path)
    assert response.status_code == status
    assert response.headers["content-security-policy"] == POLICY
    named = ("x-content-type-options", "referrer-policy", "cross-origin-opener-policy")
    assert [response.headers[name] for name in named] == ["nosniff", "no-referrer", "same-origin"]
    assert response.headers["cross-origin-resource-policy"] == "same-origin"
    kept = "no-cache" if path in ("/", f"/open/{TOKEN}", "/static/main.js") else "no-store"
    assert method != "GET" or response.headers["cache-control"] == kept
    assert "access-control-allow-origin" not in response.headers


def test_the_policy_lets_nothing_foreign_in():
    for part in POLICY.split("; "):
        name, *sources = part.split(" ")
        assert {*sources} <= {"'none'", "'self'", "data:", "blob:", "'unsafe-inline'"}
        assert "'unsafe-inline'" not in sources or name == "style-src"


HOSTS, COOKIES, ORIGINS = ("host", HOST), ("cookie", COOKIE), ("origin", ORIGIN)
OURS = [HOSTS, ORIGINS, COOKIES]


@pytest.mark.parametrize(
    ("method", "path", "headers", "status"),
    [
        ("GET", "/api/now", [COOKIES], 403),
        ("GET", "/api/now", [HOSTS, HOSTS, COOKIES], 403),
        ("POST", "/api/finish", [HOSTS, COOKIES, ORIGINS, ORIGINS], 403),
        ("POST", "/api/answer", [*OURS, ("content-length", str(LARGEST_BODY + 1))], 413),
        ("POST", "/api/record", [*OURS, ("content-length", str(LARGEST_RECORD + 1))], 413),
        *(
            ("POST", "/api/answer", [*OURS, ("content-length", length)], 400)
            for length in ("-1", "1e3", "", "9" * 30, "\u0663", "1, 1")
        ),
        ("GET", "/api/now?" + "x" * 40_000, OURS, 431),
        ("GET", "/" + "x" * 40_000, OURS, 431),
        ("GET", "/api/now", [*OURS, *((f"x-{i}", "y" * 1000) for i in range(40))], 431),
    ],
)
def test_what_no_browser_sends_is_refused_before_its_body_is_read(room, method, path, headers, status):
    assert bare(room, method, path, headers, chunks=None) == status


def test_a_body_in_endless_chunks_is_refused(room):
    endless = (b"x" * 1000 for _ in iter(int, 1))
    assert untouched(room, lambda: bare(room, "POST", "/api/answer", OURS, endless)) == 413


def test_a_client_that_goes_away_in_its_body_records_nothing(room):
    sent = untouched(room, lambda: bare(room, "POST", "/api/finish", OURS, chunks=()))
    assert sent is None


def test_a_web_socket_is_refused(room):
    assert bare(room, "GET", "/api/now", OURS, type_="websocket") == "websocket.close"


def test_a_window_beyond_this_machine_knows_its_address_and_warns():
    lan = Hosts.of("192.0.2.7", 80)
    assert lan.allow("192.0.2.7:80")
    assert lan.allow("192.0.2.7")
    assert lan.allow("localhost")
    assert not lan.allow("192.0.2.8:80")
    everywhere = Hosts.of("0.0.0.0", 8000)
    assert everywhere.allow("192.0.2.8:8000")
    assert everywhere.allow("[2001:db8::1]:8000")
    assert not everywhere.allow("2001:db8::1:8000")
    assert not everywhere.allow("[192.0.2.8]:8000")
    assert not everywhere.allow("evil.example:8000")
    assert "not encrypted" in warning("0.0.0.0")
    assert warning("127.0.0.1") == warning("::1") == ""


@pytest.mark.parametrize(
    ("address", "link"),
    [("0.0.0.0", "127.0.0.1"), ("::", "[::1]"), ("::1", "[::1]"), ("192.0.2.7", "192.0.2.7")],
)
def test_links_can_be_opened(address, link):
    assert in_link(address) == link


def bare(room, method, path, headers, chunks=(b"{}",), *, type_="http"):
    """Status of a request that no client library would send; None if there is no response."""
    path, _, query = path.partition("?")
    scope = {
        "type": type_,
        "http_version": "1.1",
        "method": method,
        "path": path,
        "root_path": "",
        "raw_path": path.encode(),
        "query_string": query.encode(),
        "scheme": "http",
        "headers": [(k.encode(), v.encode("utf-8")) for k, v in headers],
    }
    sent, left = [], None if chunks is None else iter(chunks)

    async def receive():
        assert left is not None, "the body must not be read"
        for chunk in left:
            return {"type": "http.request", "body": chunk, "more_body": True}
        return {"type": "http.disconnect"}

    async def send(message):
        sent.append(message)

    asyncio.run(room.app(scope, receive, send))
    if not sent:
        return None
    return sent[0].get("status", sent[0]["type"])
