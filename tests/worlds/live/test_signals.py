"""A live run that is told to end restores the plant, over a real OPC UA server."""

import signal
import socket
import sys
import time
from pathlib import Path

import pytest

from prefcal_env.worlds.live import Journal
from support.browser import Watched, serve

pytest.importorskip("asyncua")
DOCS = Path(__file__).parents[3] / "docs"
pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="sends POSIX signals")
TANK = """
[opcua]
url = "{url}"
duration = 60
period = 0.1
journal = "{journal}"
[opcua.knobs]
K_p = {{ node = "ns=2;s=Tank.Kp", low = 0.2, high = 10, rate = 50 }}
T_i = {{ node = "ns=2;s=Tank.Ti", low = 1, high = 60, rate = 500, unit = "s" }}
[opcua.outputs]
level = {{ node = "ns=2;s=Tank.Level", unit = "m" }}
[opcua.references]
level = {{ node = "ns=2;s=Tank.Setpoint" }}
[opcua.start]
set-point = {{ node = "ns=2;s=Tank.Setpoint", value = 1.5, low = 0.5, high = 1.8, rate = 50 }}
"""


@pytest.fixture
def tank(monkeypatch):
    monkeypatch.syspath_prepend(DOCS)
    from opcua_server import Tank

    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    with Tank(port).running() as tank:
        yield tank


@pytest.mark.parametrize("number", ["SIGINT", "SIGTERM"])
def test_a_run_that_is_told_to_end_restores_the_plant(tank, tmp_path, browser, number):
    text = TANK.format(url=tank.url, journal=tmp_path / "old.json")
    (tmp_path / "tank.toml").write_text(text, encoding="utf-8")
    served = serve(tmp_path, "tank.toml", "--n-max", "4")
    try:
        watched = Watched(browser)
        watched.page.goto(served.link)
        watched.page.click("#write-and-start", timeout=60_000)
        watched.page.wait_for_selector(".live-curve polyline.output", timeout=60_000)
        assert tank.values["Setpoint"] == pytest.approx(1.5)
        served.process.send_signal(getattr(signal, number))
        printed = "".join(served.process.communicate(timeout=60))
    finally:
        served.kill()
    time.sleep(0.2)  # the server reads its nodes every 0.02 s
    values = [tank.values[name] for name in ("Kp", "Ti", "Setpoint")]
    assert values == pytest.approx([1.0, 20.0, 1.0])
    assert "the plant gets its old values back" in printed
    assert not (tmp_path / "old.json").exists()


def to_the_trial(watched, served):
    """Run twice, prefer the second run, and let new be written: it is on the plant then."""
    page = watched.page
    page.goto(served.link)
    for number in (1, 2):
        page.wait_for_function(
            f"() => document.getElementById('live-title')?.textContent.includes('{number}')", timeout=60_000
        )
        page.click("#write-and-start", timeout=60_000)
    watched.question()
    page.keyboard.press("ArrowLeft" if served.state.open[1].challenger_left else "ArrowRight")
    watched.phase("over")
    page.click("#trial-open")
    page.click("#trial-write")
    page.wait_for_selector("#trial-keep:not([disabled])", timeout=60_000)
    page.keyboard.press("o")
    page.wait_for_selector("#trial-side:has-text('New: experiment 2')")
    page.wait_for_selector("#trial-keep:not([disabled])", timeout=60_000)


@pytest.mark.parametrize("ends", ["SIGINT", "SIGKILL", "page closed"])
def test_a_trial_that_nobody_confirms_leaves_what_the_plant_had(tank, tmp_path, browser, ends):
    text = TANK.format(url=tank.url, journal=tmp_path / "old.json").replace("duration = 60", "duration = 1")
    (tmp_path / "tank.toml").write_text(text, encoding="utf-8")
    served = serve(tmp_path, "tank.toml", "--n-max", "2")
    try:
        watched = Watched(browser)
        to_the_trial(watched, served)
        new = served.state.history.samples[1].theta
        assert [tank.values["Kp"], tank.values["Ti"]] == pytest.approx(new, rel=1e-6)
        assert (tmp_path / "old.json").exists()
        if ends == "SIGINT":
            served.stop()
        elif ends == "SIGKILL":
            served.kill()
            time.sleep(0.2)
            assert [tank.values["Kp"], tank.values["Ti"]] == pytest.approx(new, rel=1e-6)
            served = serve(tmp_path, "tank.toml", "--n-max", "2")
            watched.page.goto(served.link)
            watched.page.wait_for_selector("#trial-open", timeout=60_000)
            served.stop()
        else:
            watched.page.close()
            served.process.communicate(timeout=90)
    finally:
        served.kill()
    time.sleep(0.2)
    assert [tank.values[name] for name in ("Kp", "Ti", "Setpoint")] == pytest.approx([1.0, 20.0, 1.0])
    assert not (tmp_path / "old.json").exists()
    assert served.state.kept is None


def test_a_command_that_ends_without_its_plant_says_what_is_restored_at_the_next_start(tmp_path):
    Journal(tmp_path / "old.json").save({"K_p": 1.5, "T_i": 20.0, "set-point": 1.0})
    text = TANK.format(url="opc.tcp://127.0.0.1:1/tank", journal="old.json")
    (tmp_path / "tank.toml").write_text(text, encoding="utf-8")
    served = serve(tmp_path, "tank.toml", "--n-max", "4")
    served.process.send_signal(signal.SIGINT)
    told = " ".join("".join(served.process.communicate(timeout=60)).split())
    assert "A run was interrupted" in told
    assert "does not have its old values (K_p = 1.5, T_i = 20, set-point = 1)" in told
    assert "restored at the next start: prefcal calibrate tank.toml" in told
    assert (tmp_path / "old.json").exists()
