"""The page for a live plant: confirm, run, stop, restore and compare, in a real browser."""

import time

import pytest

from prefcal_agents import GLISp
from prefcal_agents.glisp.agent import Foresight
from prefcal_env.worlds.live import Journal, LiveRig
from prefcal_scenarios.scenario import KPI, Scenario
from support.browser import Watched, window_on
from support.page_checks import serious
from worlds.live.memory import Memory, memory_rig


@pytest.fixture
def plant():
    return Memory()


@pytest.fixture
def served(plant, tmp_path, monkeypatch):
    """A window on a plant whose seconds pass a little faster than those of the browser."""
    real, recover = LiveRig.drive, LiveRig.recover

    def sleep(seconds):
        time.sleep(seconds / 5)  # long enough to be stopped on a busy machine
        plant.sleep(seconds)

    def drive(self, theta, confirm, **rest):
        return real(self, theta, confirm, clock=plant.clock, sleep=sleep, **rest)

    def recovered(self, **rest):
        return recover(self, clock=plant.clock, sleep=sleep, **rest)

    monkeypatch.setattr(LiveRig, "drive", drive)
    monkeypatch.setattr(LiveRig, "recover", recovered)
    rig = memory_rig(plant, tmp_path, instructions="Check that the drain <is open>.", duration=40.0)
    kpi = KPI("overshoot of level", "overshoot", "m", better="lower")
    tank = Scenario("tank", "A tank", rig.space, rig, kpis=(kpi,))
    with window_on(tank, tmp_path / "mine.prefcal", 4) as window:
        yield window


def confirmed(watched):
    """Confirm the run that is waited for, once its values are shown, and see it begin."""
    watched.page.click("#write-and-start")
    watched.page.wait_for_selector("#stop-live:visible")


def test_a_run_is_confirmed_stopped_from_any_page_and_compared(browser, served, plant, monkeypatch):
    monkeypatch.setattr(GLISp, "foresight", Foresight(0.4, 2))
    monkeypatch.setattr(GLISp, "foresees", True)
    watched = Watched(browser)
    page = watched.page
    page.goto(served.link)
    page.wait_for_selector("#write-and-start")
    shown = page.inner_text("#view-live").replace("\xa0", " ")
    for words in (
        "10 s",
        "1 to 60 s",
        "5 s",
        "set-point",
        "→ 2 m",
        "the drain <is open>",
        "experiment 1 is noticeably",
    ):
        assert words in shown
    assert plant.writes == []
    assert serious(page) == []
    watched.shot("live-confirm")
    confirmed(watched)
    page.wait_for_selector(".live-curve polyline.output")
    assert "left" in page.inner_text("#live-left")
    assert serious(page) == []
    watched.shot("live-run")
    page.keyboard.press("?")
    page.wait_for_selector("dialog[open]")
    page.keyboard.press("k")
    watched.phase("failed")
    page.keyboard.press("Escape")
    assert "The old values are restored" in page.inner_text("#view-failed")
    assert [plant.values[node] for node in ("kp", "ti", "sp")] == pytest.approx([1.0, 10.0, 1.0])
    page.click("text=Count it as failed")
    page.wait_for_function("() => document.getElementById('live-title')?.textContent.includes('2')")
    page.wait_for_selector("#write-and-start")
    confirmed(watched)
    page.keyboard.press("h")
    page.wait_for_selector("#view-history:visible")
    assert page.is_visible("#stop-live")
    page.keyboard.press("Escape")
    watched.question()
    assert [plant.values[node] for node in ("kp", "ti", "sp")] == pytest.approx([1.0, 10.0, 1.0])
    assert len(served.state.finished) == 2
    page.keyboard.press("ArrowRight")
    watched.phase("confirm")
    assert served.state.history.answered == 2
    assert watched.errors == []


def titled(page, words):
    """Wait until the title of the plant's page holds these words."""
    page.wait_for_function(
        "words => document.getElementById('live-title')?.textContent.includes(words)", arg=words
    )


def test_a_recovery_that_fails_is_on_every_page_until_it_succeeds(browser, plant, tmp_path, request):
    Journal(tmp_path / "old.json").save({"K_p": 1.5, "T_i": 10.0, "set-point": 1.0})
    plant.up = False
    served = request.getfixturevalue("served")
    watched = Watched(browser, viewport={"width": 390, "height": 780}, color_scheme="dark")
    page = watched.page
    page.goto(served.link)
    titled(page, "Restoring the values from before an interrupted run")
    assert not page.is_visible("#stop-live")
    assert serious(page) == []
    watched.shot("live-recovering")
    plant.refuses, plant.up = "kp", True
    titled(page, "does not have its old values yet")
    assert "K_p: the server memory refuses" in page.inner_text("#view-live")
    assert page.query_selector("#write-and-start") is None
    assert serious(page) == []
    page.keyboard.press("h")
    page.wait_for_selector("#view-history:visible")
    assert "K_p: the server memory refuses" in page.inner_text("#unrestored")
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    assert serious(page) == []
    watched.shot("live-unrestored")
    plant.refuses = ""
    page.click("#unrestored button")
    page.wait_for_selector("#unrestored", state="hidden")
    page.keyboard.press("Escape")
    page.wait_for_selector("#write-and-start")
    assert "1.5" in page.inner_text("#view-live")
    assert plant.values["kp"] == pytest.approx(1.5)
    assert watched.errors == []


def test_a_run_that_lost_its_connection_cannot_be_stopped_again(browser, plant, served):
    watched = Watched(browser)
    page = watched.page
    page.goto(served.link)
    page.wait_for_selector("#write-and-start")
    # Lost by the plant's own clock: on a busy machine the run may be over before the page shows it.
    plant.at = lambda p: setattr(p, "up", p.values["level"] < 1.5)
    page.click("#write-and-start")
    titled(page, "has ended: the plant gets its old values back")
    assert "Connection lost" in page.inner_text("#live-stage")
    assert not page.is_visible("#stop-live")
    assert not page.is_visible("#live-stop")
    watched.shot("live-lost")
    plant.at, plant.up = lambda p: None, True
    watched.phase("failed")
    assert "was not completed" in page.inner_text("#failed-title")
    assert plant.values["kp"] == pytest.approx(1.0)
    assert watched.errors == []


def test_a_plant_that_cannot_be_reached_is_read_again(browser, plant, served):
    watched = Watched(browser, viewport={"width": 390, "height": 780})
    page = watched.page
    page.goto(served.link)
    page.wait_for_selector("#write-and-start")
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    watched.shot("live-narrow")
    plant.up = False
    page.click("#read-again")
    page.wait_for_selector("#view-live .problem")
    assert "no connection to memory" in page.inner_text("#view-live")
    assert page.query_selector("#write-and-start") is None
    plant.up = True
    page.click("#read-again")
    page.wait_for_selector("#write-and-start")
    confirmed(watched)
    page.wait_for_selector(".live-curve polyline.output")
    watched.shot("live-narrow-run")
    page.click("#live-stop")
    watched.phase("failed")
    assert plant.values["kp"] == pytest.approx(1.0)
    assert watched.errors == []
