"""The page for a rig, for maneuvers, for a plant that breaks down or never returns, in a real browser."""

import sys
from pathlib import Path

import numpy as np
import pytest

from prefcal_scenarios.own import module_at
from support.browser import Watched, serve, window_on
from support.page_checks import pixels, serious
from toy_scenario_tools import record_of_toy
from toy_study import TOY

RIG = """
from dataclasses import replace
from pathlib import Path
import numpy as np
from prefcal_env import Channel, Channels, Rig
from prefcal_scenarios import Scenario, load
toy = load({toy!r})
LEVEL = Channel("level <h>", "m", target=2.0, band=0.06)
channels = Channels(x=(LEVEL,), u=(Channel("valve", "%"),), y=(LEVEL,), time_unit="h")
rig = Rig(channels, (2.0,), instructions="Open the tap.")
rig = replace(toy, references={{}}, cost=None, kpis=(), run=rig)
runs = []
def run(theta, seed=0):
    runs.append(theta)
    if len(runs) > 2 and not Path("mended").exists():
        raise OSError("the pump does not answer")
    return toy.run(theta, seed)
pump = replace(toy, run=run)
"""


@pytest.fixture
def own(tmp_path):
    (tmp_path / "own.py").write_text(RIG.format(toy=TOY), encoding="utf-8")
    return tmp_path


def test_a_rigs_records_are_dropped_refused_and_compared(browser, command, own):
    served, watched = command("own.py:rig", n_max=4), Watched(browser)
    page = watched.page
    page.goto(served.link)
    watched.phase("record")
    assert "Experiment 1" in page.inner_text("#record-title")
    assert "Open the tap." in page.inner_text("#view-record")
    assert "level <h> [m]" in page.inner_text("#view-record")
    bad = {"name": "bad.csv", "mimeType": "text/csv", "buffer": b"time [m],valve [%]\n0,1\n1,2\n"}
    page.set_input_files("#record-file", bad)
    page.wait_for_selector(".refused:not([hidden])")
    told = page.inner_text(".refused")
    assert "column 'level <h>' is missing" in told
    assert "column 'time' is in m, expected h" in told
    watched.shot("rig-refused")
    assert served.state.finished == {}
    good = {"name": "good.csv", "mimeType": "text/csv", "buffer": record_of_toy().encode()}
    page.set_input_files("#record-file", good)
    page.wait_for_selector("#record-save")
    assert "30 rows, from 0 h to 14.5 h" in page.inner_text("#record-preview")
    assert served.state.finished == {}
    watched.shot("rig-preview")
    page.click("#record-save")
    page.wait_for_function("() => document.getElementById('record-title').textContent.includes('2')")
    page.set_input_files("#record-file", good)
    page.wait_for_selector(".warning")
    assert "exactly the curves of experiment 1" in page.inner_text(".warning")
    watched.shot("rig-same")
    other = {**good, "buffer": record_of_toy(20).encode()}
    page.click("text=I used other values")
    page.fill(".dials input >> nth=0", "1.07")
    page.check("#became-unsafe")
    page.set_input_files("#record-file", other)
    page.wait_for_function("() => document.getElementById('record-preview').textContent.includes('20 rows')")
    watched.shot("rig-dialed")
    page.click("#record-save")
    watched.question()
    assert served.state.history.samples[1].theta[0] == pytest.approx(1.07)
    assert "unsafe" in page.inner_text("#pair")
    watched.shot("rig-question")
    page.click("#replace")
    right = {**good, "buffer": record_of_toy(25).encode()}
    page.set_input_files("#replace-file", right)
    page.wait_for_selector("#replace-save")
    watched.shot("rig-replace")
    page.click("#replace-save")
    page.wait_for_function("() => !document.getElementById('dialog').open")
    watched.question()
    assert len(list(served.state.finished)) == 2
    assert "unsafe" not in page.inner_text("#pair")
    page.keyboard.press("ArrowLeft")
    watched.phase("record")
    page.click("text=The run failed")
    page.click("text='It failed'")
    watched.question()
    assert "left no record" in page.inner_text("#pair")
    watched.shot("rig-no-record")
    assert watched.errors == []


def _to_the_trial(served, watched):
    """Go to the end of a study of two records, the second of which is better."""
    page = watched.page
    page.goto(served.link)
    for k, rows in enumerate((30, 20)):
        watched.phase("record")
        page.wait_for_function(
            f"() => document.getElementById('record-title').textContent.includes('{k + 1}')"
        )
        content = record_of_toy(rows).encode()
        page.set_input_files("#record-file", {"name": "a.csv", "mimeType": "text/csv", "buffer": content})
        page.click("#record-save")
    watched.question()
    page.keyboard.press("ArrowLeft" if served.state.open[1].challenger_left else "ArrowRight")
    watched.phase("over")


def test_old_and_new_are_one_key_apart_at_the_end_and_one_is_confirmed(browser, command, own):
    served, watched = command("own.py:rig", n_max=2), Watched(browser)
    page = watched.page
    _to_the_trial(served, watched)
    page.keyboard.press("?")
    page.get_by_text("while you try old and new on the plant").scroll_into_view_if_needed()
    watched.shot("rig-trial-keys")
    page.keyboard.press("Escape")
    page.click("#trial-open")
    assert "Old: first experiment (experiment 1)" in page.inner_text("#trial-side")
    page.keyboard.press("o")
    assert "New: experiment 2" in page.inner_text("#trial-side")
    watched.shot("rig-trial")
    page.click("text=Close, confirm nothing")
    assert served.state.kept is None
    page.click("#trial-blind")
    shown = [page.inner_text("#trial-side")]
    page.keyboard.press("o")
    shown.append(page.inner_text("#trial-side"))
    assert [text.split()[0] for text in shown] == ["A", "B"]
    behind = page.eval_on_selector("#dialog", "it => getComputedStyle(it, '::backdrop').backgroundColor")
    assert behind.startswith("rgb("), "the result behind would tell A from B"
    watched.shot("rig-trial-blind")
    page.click("text=This one stays")
    page.wait_for_selector("text=Confirmed on the plant:")
    which = ("old", "new")[served.state.kept[2].index]
    assert f"Confirmed on the plant: {which}" in page.inner_text("#view-over")
    assert served.state.kept[2].blind
    watched.shot("rig-kept")
    assert watched.errors == []


def test_what_was_confirmed_survives_a_kill_whose_reply_is_lost(browser, command, own):
    served, watched = command("own.py:rig", n_max=2), Watched(browser)
    page = watched.page
    _to_the_trial(served, watched)

    def lose_the_reply(route):
        route.fetch()
        served.kill()
        route.abort()

    page.route("**/api/keep_on_plant*", lose_the_reply)
    page.click("#trial-open")
    page.keyboard.press("o")
    page.click("text=This one stays")
    page.wait_for_selector("#banner:not([hidden])")
    again = command("own.py:rig", n_max=2)
    page.goto(again.link)
    watched.phase("over")
    page.wait_for_selector("text=Confirmed on the plant: new (experiment 2)")
    assert again.state.kept[2].index == 1


def test_a_plant_that_breaks_down_is_tried_again(browser, command, own):
    served, watched = command("own.py:pump", n_max=4), Watched(browser)
    watched.open(served.link)
    watched.page.keyboard.press("ArrowLeft")
    watched.phase("failed")
    assert "the pump does not answer" in watched.page.inner_text("#view-failed")
    watched.shot("failed")
    assert served.state.history.answered == 2
    (own / "mended").touch()
    watched.page.click("button:has-text('Try again')")
    watched.question()
    assert len(served.state.finished) == 3


DOCS = Path(__file__).parents[3] / "docs"
BLUE, ORANGE = (11, 99, 194), (185, 58, 6)


@pytest.fixture
def served(tmp_path):
    tank = module_at(DOCS / "heated_tank.py").heated_tank
    with window_on(tank, tmp_path / "mine.prefcal", 4) as window:
        yield tank, window
    sys.modules.pop("heated_tank", None)


def _largest(tank, page):
    """Maneuver and time at which the temperatures differ most, as a share of the drawn axes."""
    theta = [
        [float(t.split()[0]) for t in page.locator(f"#{side}-thetas dd").all_inner_texts()]
        for side in ("left", "right")
    ]
    runs = [tank.run(np.array(values)).runs for values in theta]
    found = {}
    for k, (a, b) in enumerate(zip(*runs, strict=True)):
        page.keyboard.press(str(k + 1))
        page.wait_for_timeout(150)
        low, high = page.evaluate("() => document.getElementById('left-plot')._fullLayout.yaxis.range")
        apart = np.abs(np.interp(a.t, b.t, b.x[:, 0]) - a.x[:, 0]) / (high - low)
        found[a.maneuver] = (float(apart.max()), float(a.t[apart.argmax()]))
    name = max(found, key=lambda key: found[key][0])
    page.keyboard.press("j")
    page.wait_for_timeout(200)
    return name, found[name][1]


def test_tabs_show_each_maneuver_and_j_finds_the_largest_difference(browser, served):
    tank, window = served
    watched = Watched(browser)
    watched.open(window.link)
    page = watched.page
    assert page.locator("#maneuvers .tab .name").all_inner_texts() != []
    page.keyboard.press("2")
    page.wait_for_timeout(200)
    assert "load" in page.inner_text("#maneuvers [aria-pressed=true]")
    for color, side in ((BLUE, "left"), (ORANGE, "right")):
        assert pixels(page, f"#{side}-plot", color) > 400
        assert pixels(page, "#maneuvers .tab >> nth=1", color) > 50
    page.keyboard.press("j")
    page.wait_for_timeout(200)
    chosen = page.locator("#maneuvers .tab[aria-pressed=true]")
    assert "most" in chosen.get_attribute("class").split()
    name, time = _largest(tank, page)
    assert name in chosen.inner_text()
    read = page.inner_text("#left-plot output >> nth=0")
    assert float(read.partition("@ ")[2].split()[0]) == pytest.approx(time, abs=0.06)
    assert serious(page) == []
    assert watched.errors == []


HANGS = Path(__file__).parents[2] / "support" / "wild_runs.py"


def test_a_run_that_hangs_is_stopped_on_the_page(tmp_path, browser):
    served = serve(tmp_path, f"{HANGS}:hangs", "--seed", "5", "--n-init", "3")
    try:
        watched = Watched(browser)
        page = watched.page
        page.goto(served.link)
        page.wait_for_selector("#stop-run:visible")
        assert page.inner_text("#wait-title") == "Running experiment 1"
        assert "A run is stopped after 1 h (--run-timeout)" in page.inner_text("#stop-text")
        watched.shot("stop-run")
        page.click("#stop-run")
        watched.phase("failed")
        assert "you stopped the run after" in page.inner_text("#view-failed .problem")
        page.click("button:text('Count it as failed')")
        watched.phase("question")
        assert watched.errors == []
    finally:
        served.stop()
