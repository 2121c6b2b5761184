"""Maneuvers in the query window: tabs, their curves, and the key to the largest difference."""

import sys
from pathlib import Path

import numpy as np
import pytest

from prefcal_scenarios.own import module_at
from support.browser import Watched, window_on
from support.page_checks import pixels, serious

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
