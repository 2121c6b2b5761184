"""The window on a real socket: bound at once, closed in time, apart from others."""

import socket
import threading
import time

import httpx
import pytest

from prefcal_app.session import Choice
from prefcal_app.web import Window
from prefcal_app.web.serve import Presence, bind
from prefcal_env.errors import SettingsError
from support.interviews import begin, proceed


@pytest.fixture
def interview(toy):
    begun = begin(toy)
    proceed(begun)
    return begun


def page(window: Window) -> httpx.Client:
    """A browser that has opened the link, as far as the cookie is concerned."""
    base, _, token = window.link.partition("/open/")
    cookie = f"prefcal_{window.port}={token}"
    return httpx.Client(
        base_url=base, headers={"cookie": cookie, "origin": base}, timeout=20, trust_env=False
    )


def test_a_window_serves_until_it_is_closed(interview, tmp_path):
    with Window(interview) as window, page(window) as browser:
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
    with page(window) as browser:
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
        with page(one) as browser, page(other) as second:
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
            with page(window) as browser:
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
    with window, page(window) as browser:
        poll = threading.Thread(target=browser.get, args=("/api/now",), kwargs={"params": {"after": version}})
        poll.start()
        while window.waiting < 1:
            time.sleep(0)
        now[0] = 9.0
        begun.steps.answer(begun.now().question.id, Choice.LEFT)
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
        with page(window) as browser:  # the name is one of ours, a foreign one still is not
            ours = {"host": f"{name}:{window.port}", "origin": f"http://{name}:{window.port}"}
            assert browser.get("/api/now", headers=ours).status_code == 200
            evil = {"host": f"evil.example:{window.port}"}
            assert browser.get("/api/now", headers=evil).status_code == 403
    with Window(interview) as window:
        assert window.link_for_others == window.warning == ""


def test_nothing_is_printed(interview, capfd):
    with Window(interview) as window, page(window) as browser:
        browser.get("/nowhere")
        with socket.create_connection(("127.0.0.1", window.port)) as rude:
            rude.sendall(b"\x16\x03\x01 no http at all\r\n\r\n")
            rude.recv(1000)
    assert capfd.readouterr() == ("", "")
