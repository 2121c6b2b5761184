"""The page of two runs in a real browser: curves, overlay, cursor, keys."""

import numpy as np
import pytest

from prefcal_app.looking.look import LookWindow, look, run_of
from prefcal_env import recorded
from support.browser import Watched
from support.page_checks import pixels, serious

BLUE, ORANGE = (11, 99, 194), (185, 58, 6)


def run(name, speed, n=201):
    t = np.linspace(0, 50, n)
    y = 2 - 2 * np.exp(-speed * t)
    made = recorded([0.0], t, {"level": y}, reference={"level": 2.0}, units={"level": "m"})
    return run_of(name, made, "made by hand")


def test_three_runs_two_at_a_time(browser):
    runs = [run("<b>.csv", 0.2), run("b.csv", 0.05, 77), run("c.csv", 0.4)]
    with LookWindow(runs) as window:
        watched = Watched(browser)
        page = watched.page
        page.goto(window.link)
        page.wait_for_selector("#right-plot .js-line")
        page.wait_for_timeout(300)
        assert page.inner_text("#scenario") == "<b>.csv and b.csv"
        assert pixels(page, "#left-plot", BLUE) > 400
        assert pixels(page, "#right-plot", ORANGE) > 400
        for key in ("o", "t", "j"):
            page.keyboard.press(key)
        page.wait_for_timeout(400)
        assert pixels(page, "#both-plot", BLUE) > 400
        assert pixels(page, "#both-plot", ORANGE) > 200
        # The cursor is where they differ most: read off both values there.
        left, right, at = values(page.inner_text("#both-plot output"))
        assert left == pytest.approx(2 - 2 * np.exp(-0.2 * at), abs=0.01)
        assert right == pytest.approx(2 - 2 * np.exp(-0.05 * at), abs=0.01)
        assert at == pytest.approx(np.log(4) / 0.15, abs=0.7)
        assert "integrated error of level" in page.inner_text("#compare")
        assert serious(page) == []
        page.keyboard.press("x")
        page.wait_for_function("() => document.title.startsWith('b.csv and <b>.csv')")
        page.keyboard.press("n")
        page.wait_for_function("() => document.title.startsWith('<b>.csv and c.csv')")
        page.select_option("#choose-left", "1")
        page.wait_for_function("() => document.title.startsWith('b.csv and c.csv')")
        page.keyboard.press("?")
        assert "made by hand" in page.inner_text("#dialog")
        assert "unsafe" not in page.inner_text("#dialog")
        page.keyboard.press("Escape")
        page.set_viewport_size({"width": 390, "height": 800})
        assert page.evaluate("() => document.documentElement.scrollWidth") == 390
        assert watched.errors == []


def values(text):
    both, at = text.split("=")[1].split("@")
    left, right = both.split("|")
    return float(left), float(right), float(at.split()[0])


def test_show_opens_the_page_until_told_to_end(monkeypatch, capsys):
    opened, seen = [], []
    monkeypatch.setattr("prefcal_app.web.open_browser", opened.append)
    t = np.arange(3.0)
    pair = look(recorded([0.0], t, {"level": t}), recorded([0.0], t, {"level": 2 * t}))
    pair.show(wait=lambda: seen.append(capsys.readouterr().out.strip()))
    assert seen == opened
    assert opened[0].startswith("http://127.0.0.1:")
