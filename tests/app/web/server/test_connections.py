"""Requests that are sent in half: they are dropped, and an honest client is served meanwhile."""

import socket
import time
from contextlib import ExitStack, contextmanager

import httpx
import pytest

from prefcal_app.web import Window, security
from support.interviews import begin, proceed

HALF_A_HEAD = b"GET / HTTP/1.1\r\nHost: 127.0.0.1"


@pytest.fixture
def window(toy, monkeypatch):
    """A window with little patience: a second for heads, and for bodies."""
    monkeypatch.setattr(security, "HEAD_SECONDS", 1.0)
    monkeypatch.setattr(security, "BODY_SECONDS", 1.0)
    monkeypatch.setattr(security, "_AFTER", 1.0)
    monkeypatch.setattr(security, "BODY_SECONDS", 1.0)
    interview = begin(toy)
    proceed(interview)
    with Window(interview) as serving:
        yield serving


@contextmanager
def page(window):
    base, _, token = window.link.partition("/open/")
    headers = {"cookie": f"prefcal_{window.port}={token}", "origin": base}
    with httpx.Client(base_url=base, headers=headers, timeout=20, trust_env=False) as browser:
        yield browser


def half_a_body(window, *, method=b"POST", stranger=False):
    base, _, token = window.link.partition("/open/")
    cookie = "" if stranger else f"Cookie: prefcal_{window.port}={token}\r\n"
    head = (
        f" /api/fail HTTP/1.1\r\nHost: 127.0.0.1:{window.port}\r\nOrigin: {base}\r\n{cookie}"
        'Content-Type: application/json\r\nContent-Length: 900\r\n\r\n{"text'
    )
    return method + head.encode()


def opened(window, sent, stack, count=1):
    made = []
    for _ in range(count):
        made.append(stack.enter_context(socket.create_connection(("127.0.0.1", window.port))))
        made[-1].sendall(sent)
    return made


def is_open(connection):
    """Whether it is; what has come is read."""
    connection.setblocking(False)
    try:
        while connection.recv(1 << 16):
            pass
    except BlockingIOError:
        return True
    except OSError:
        pass
    return False


def all_are_closed(made, within):
    until = time.monotonic() + within
    while sum(map(is_open, made)):  # each is read
        if time.monotonic() > until:
            return False
        time.sleep(0.02)
    return True


def test_half_sent_heads_are_dropped_and_an_honest_client_is_served_meanwhile(window):
    with ExitStack() as stack, page(window) as browser:
        made = opened(window, HALF_A_HEAD, stack, 200)
        assert browser.get("/api/now").status_code == 200
        time.sleep(0.2)
        assert sum(map(is_open, made)) <= security.MOST_WAITING
        with page(window) as fresh:
            assert fresh.get("/api/now").status_code == 200
        assert all_are_closed([*made, *opened(window, b"", stack, 3)], within=5)  # or nothing
        assert browser.get("/api/now").status_code == 200


def test_a_connection_that_makes_way_is_told_to_try_again(window):
    with ExitStack() as stack:
        first, *_ = opened(window, b"", stack, security.MOST_WAITING + 1)
        first.setblocking(True)
        first.settimeout(5)
        head, _, body = b"".join(iter(lambda: first.recv(4096), b"")).partition(b"\r\n\r\n")
        assert head.startswith(b"HTTP/1.1 503 ")
        assert b"Retry-After: 1" in head
        assert f"Content-Length: {len(body)}".encode() in head


@pytest.mark.parametrize("method", [b"POST", b"GET"])
def test_half_sent_bodies_are_dropped(window, method):
    with ExitStack() as stack, page(window) as browser:
        made = opened(window, half_a_body(window, method=method), stack, 60)
        assert browser.get("/api/now").status_code == 200
        assert browser.post("/api/finish", json={}).status_code == 200
        assert all_are_closed(made, within=8)


def test_a_slow_client_is_told(window):
    with ExitStack() as stack:
        (slow,) = opened(window, half_a_body(window), stack)
        slow.settimeout(5)
        answer = slow.recv(1 << 16)
        assert answer.startswith(b"HTTP/1.1 408 ")
        assert b"Nothing was saved; send it again" in answer + slow.recv(1 << 16)


def test_a_stranger_holds_no_connection(window):
    with ExitStack() as stack:
        assert all_are_closed(opened(window, half_a_body(window, stranger=True), stack), 0.8)


def test_a_connection_that_is_kept_takes_another_request_after_a_while(window):
    with page(window) as browser:
        assert browser.get("/api/now").status_code == 200
        time.sleep(1.2)  # longer than a head may take
        assert browser.get("/api/now").status_code == 200
