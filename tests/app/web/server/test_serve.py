"""The window on a real socket: opened, bound at once, honest clients served, closed in time."""

import socket
import threading
import time
import webbrowser
from contextlib import ExitStack, contextmanager

import httpx
import pytest

from prefcal_app.session import Choice, actions
from prefcal_app.web import Window, open_browser, security
from prefcal_app.web.serve import Presence, bind
from prefcal_env.errors import SettingsError
from support.interviews import begin, proceed


@pytest.fixture
def interview(toy):
    begun = begin(toy)
    proceed(begun)
    return begun


def client_of(window: Window) -> httpx.Client:
    """A browser that has opened the link, as far as the cookie is concerned."""
    base, _, token = window.link.partition("/open/")
    cookie = f"prefcal_{window.port}={token}"
    return httpx.Client(
        base_url=base, headers={"cookie": cookie, "origin": base}, timeout=20, trust_env=False
    )


def test_a_window_serves_until_it_is_closed(interview, tmp_path):
    with Window(interview) as window, client_of(window) as browser:
        assert window.reports is None
        window.reports = tmp_path
        assert window.reports == tmp_path
        assert window.link.startswith(f"http://127.0.0.1:{window.port}/open/")
        assert browser.get("/api/now").json()["phase"] == "question"
        assert not window.closed.is_set()
        assert browser.post("/api/close", json={}).status_code == 200
        assert window.closed.wait(10)
    with pytest.raises(httpx.ConnectError):
        httpx.get(window.link, trust_env=False)


def test_the_link_can_be_opened_before_the_server_runs(interview):
    window = Window(interview)
    status = []
    with client_of(window) as browser:
        early = threading.Thread(target=lambda: status.append(browser.get("/api/now").status_code))
        early.start()
        with window:
            early.join(20)
    assert status == [200]


def test_a_response_does_not_wait_for_the_acknowledgment_of_its_first_part():
    with bind("127.0.0.1", 0) as listening, socket.create_connection(listening.getsockname()):
        accepted, _ = listening.accept()
        with accepted:
            assert accepted.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)


def test_no_two_links_are_alike(interview):
    with Window(interview) as one, Window(interview) as other:
        assert one.port != other.port
        assert one.link.rpartition("/")[2] != other.link.rpartition("/")[2]
        assert len(one.link.rpartition("/")[2]) >= 43
        with client_of(one) as browser, client_of(other) as second:
            assert browser.get("/api/now").status_code == second.get("/api/now").status_code == 200
            crossed = {"cookie": browser.headers["cookie"]}
            assert second.get("/api/now", headers=crossed).status_code == 401


@pytest.mark.parametrize("port", [-1, 65536, 10**30])
def test_an_impossible_port_is_refused(interview, port):
    with pytest.raises(SettingsError, match="port must be in"):
        Window(interview, port=port)


@pytest.mark.parametrize("host", ["192.0.2.1", "no-such-host.invalid", "a" * 300, "", "1.2.3.4.5"])
def test_a_host_of_another_machine_is_refused(interview, host):
    with pytest.raises(SettingsError, match="host"):
        Window(interview, host=host)


def test_a_window_closes_in_time_though_pages_wait(interview):
    version = interview.now().version
    status = []
    with Window(interview) as window:

        def poll() -> None:
            with client_of(window) as browser:
                status.append(browser.get("/api/now", params={"after": version}).status_code)

        tabs = [threading.Thread(target=poll) for _ in range(5)]
        for tab in tabs:
            tab.start()
        while window.waiting < 5:
            time.sleep(0)
    assert window.waiting == 0  # each had its response
    for tab in tabs:
        tab.join(10)
    assert status == [200] * 5


def test_a_window_closes_in_time_though_a_request_never_ends(interview):
    window = Window(interview)
    with window, socket.create_connection(("127.0.0.1", window.port)) as half:
        half.sendall(b"GET /api/now HTTP/1.1\r\nHost: ")
        closing = threading.Thread(target=window.__exit__, args=(None, None, None), daemon=True)
        closing.start()
        closing.join(20)
        assert not closing.is_alive()


@pytest.mark.parametrize("known", [True, False])
def test_a_chunked_body_without_end_is_cut_off(interview, known):
    chunk = b"2710\r\n" + b"x" * 10_000 + b"\r\n"
    with Window(interview) as window:
        base, _, token = window.link.partition("/open/")
        cookie = f"Cookie: prefcal_{window.port}={token if known else 'wrong'}"
        head = ["POST /api/finish HTTP/1.1", f"Host: 127.0.0.1:{window.port}", f"Origin: {base}"]
        head += [cookie, "Content-Type: application/json", "Transfer-Encoding: chunked", "", ""]
        with socket.create_connection(("127.0.0.1", window.port), timeout=20) as endless:
            endless.sendall("\r\n".join(head).encode())
            with pytest.raises(ConnectionError):
                endless.sendall(chunk * 10_000)  # 100 MB
    assert interview.now().state.ended is None


def test_a_page_that_waits_is_there_until_its_wait_ends(toy):
    begun = begin(toy)
    version = proceed(begun).version
    now = [0.0]
    window = Window(begun, clock=lambda: now[0])
    with window, client_of(window) as browser:
        poll = threading.Thread(target=browser.get, args=("/api/now",), kwargs={"params": {"after": version}})
        poll.start()
        while window.waiting < 1:
            time.sleep(0)
        now[0] = 9.0
        begun.do(actions.Answer(begun.now().question.id, Choice.LEFT))
        poll.join(20)
        now[0] = 10.0
        assert window.away() == 1.0


def test_how_long_no_page_has_been_open():
    now = [1e6]
    presence = Presence(lambda: now[0])
    assert presence.away() is None  # before the first page
    presence.seen(True)
    now[0] += 10.0
    assert presence.away() == 10.0
    presence.seen(True)
    assert presence.away() == 0.0
    presence.seen(False)  # in a hidden tab, it may be silent for a minute
    now[0] += 65.0
    assert presence.away() == 0.0
    now[0] += 30.0
    assert presence.away() == 25.0


def test_a_window_for_the_network_prints_an_address_that_others_can_use(interview):
    with Window(interview, host="0.0.0.0") as window:
        assert "everybody on that network" in window.warning
        name = window.link_for_others.partition("//")[2].partition(":")[0]
        assert name not in ("127.0.0.1", "0.0.0.0", "localhost", "")
        token = window.link.rpartition("/")[2]
        assert window.link_for_others == f"http://{name}:{window.port}/open/{token}"
        with client_of(window) as browser:  # the name is one of ours, a foreign one still is not
            ours = {"host": f"{name}:{window.port}", "origin": f"http://{name}:{window.port}"}
            assert browser.get("/api/now", headers=ours).status_code == 200
            evil = {"host": f"evil.example:{window.port}"}
            assert browser.get("/api/now", headers=evil).status_code == 403
    with Window(interview) as window:
        assert window.link_for_others == window.warning == ""


def test_nothing_is_printed(interview, capfd):
    with Window(interview) as window, client_of(window) as browser:
        browser.get("/nowhere")
        with socket.create_connection(("127.0.0.1", window.port)) as rude:
            rude.sendall(b"\x16\x03\x01 no http at all\r\n\r\n")
            rude.recv(1000)
    assert capfd.readouterr() == ("", "")


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


SCREEN = {"DISPLAY": ":0"}


class Graphical(webbrowser.BaseBrowser):
    """Remembers what it was asked to open."""

    def __init__(self, name="firefox", works=True):
        super().__init__(name)
        self.opened, self._works = [], works

    def open(self, url, new=0, autoraise=True):
        self.opened.append(url)
        return self._works


def found(monkeypatch, browser):
    monkeypatch.setattr(webbrowser, "get", lambda using=None: browser)
    return browser


@pytest.mark.parametrize(
    ("environ", "platform", "opens"),
    [
        (SCREEN, "linux", True),
        ({"WAYLAND_DISPLAY": "wayland-0"}, "linux", True),
        ({"DISPLAY": ""}, "linux", False),
        ({}, "darwin", True),
    ],
)
def test_a_graphical_browser_is_opened_where_there_is_a_display(monkeypatch, environ, platform, opens):
    browser = found(monkeypatch, Graphical())
    assert open_browser("http://x/", environ=environ, platform=platform) is opens
    assert browser.opened == ["http://x/"] * opens


@pytest.mark.parametrize("name", ["w3m", "/usr/bin/lynx", "www-browser", "links", "elinks"])
def test_no_browser_that_would_run_in_the_terminal_is_opened(monkeypatch, name):
    browser = found(monkeypatch, Graphical(name))
    assert not open_browser("http://x/", environ=SCREEN, platform="linux")
    assert browser.opened == []
    found(monkeypatch, webbrowser.GenericBrowser("/bin/false"))
    assert not open_browser("http://x/", environ=SCREEN, platform="linux")


def test_no_browser_is_no_error(monkeypatch):
    def none(using=None):
        raise webbrowser.Error("could not locate runnable browser")

    monkeypatch.setattr(webbrowser, "get", none)
    assert not open_browser("http://x/", environ=SCREEN, platform="linux")
    found(monkeypatch, Graphical(works=False))
    assert not open_browser("http://x/", environ=SCREEN, platform="linux")
