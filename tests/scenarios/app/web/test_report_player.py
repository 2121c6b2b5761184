"""The animation of a report in a browser, under the policy that the query window gives reports."""

import io

import numpy as np
import pytest
from PIL import Image

from prefcal_agents import RandomSearch
from prefcal_env.preferences.answer import Preference
from prefcal_env.preferences.loop import calibrate
from prefcal_scenarios.app.presentation.style import BEST, OTHERS
from prefcal_scenarios.app.report.html import page
from prefcal_scenarios.app.report.pictures import Drawn
from prefcal_scenarios.app.report.record import Record
from prefcal_scenarios.app.web.server.security import REPORT_POLICY
from prefcal_scenarios.cases.overtake import overtake
from prefcal_scenarios.cases.overtake.pictures.pictures import PICTURES
from support.browser import Watched

ADDRESS = "http://127.0.0.1:1/report.html"


class Newer:
    """A calibrator who prefers whatever is newer."""

    def prefer(self, challenger, incumbent):
        return Preference.CHALLENGER


@pytest.fixture(scope="module")
def text():
    """A report that holds the animation alone."""
    agent = RandomSearch(overtake.space, n_init=2, n_max=2, seed=0)
    comparisons = tuple(calibrate(agent, overtake.run, Newer()))
    held = agent.state.history.incumbents()
    record = Record(overtake, "overtake", comparisons, held, n_max=2)
    film = PICTURES[0]
    assert film.markup is not None
    return page(record, [Drawn(film, "alt", b"", film.markup(record))])


def opened(browser, text, **options):
    watched = Watched(browser, **options)
    headers = {"content-security-policy": REPORT_POLICY, "content-type": "text/html"}
    watched.page.route(ADDRESS, lambda route: route.fulfill(body=text, headers=headers))
    watched.page.goto(ADDRESS)
    return watched


def pixels(page, selector, color):
    shot = Image.open(io.BytesIO(page.locator(selector).first.screenshot())).convert("RGB")
    rgb = [int(color[i : i + 2], 16) for i in (1, 3, 5)]
    return int(np.sum(np.abs(np.asarray(shot).astype(int) - rgb).max(axis=2) < 20))


def test_it_plays_pauses_and_scrubs_and_asks_for_nothing(browser, text):
    watched = opened(browser, text, color_scheme="light")
    shown = watched.page
    assert shown.locator(".road svg").count() == 2
    button, scrub = shown.locator(".player button"), shown.locator(".player input")
    still = shown.locator(".road").first.screenshot()
    button.click()
    assert button.get_attribute("aria-label") == "Pause"
    shown.wait_for_function("() => document.querySelector('.player input').value > 0.3")
    assert float(scrub.input_value()) < 5  # the first time, it plays from the beginning
    button.click()
    paused = scrub.input_value()
    shown.wait_for_timeout(150)
    assert scrub.input_value() == paused
    assert shown.locator(".road").first.screenshot() != still
    scrub.fill("7")
    assert shown.inner_text(".player output").startswith("7.0 s of")
    assert shown.inner_text(".player .now").endswith("km/h")
    assert pixels(shown, ".road", BEST) > 200
    assert pixels(shown, ".road", OTHERS[0]) > 200
    assert watched.errors == []
    assert all(r == ADDRESS or r.startswith("data:") for r in watched.requests)


def test_without_scripts_both_roads_are_pictures(browser, text):
    shown = opened(browser, text, java_script_enabled=False, color_scheme="light").page
    assert shown.locator(".road img").count() == 2
    assert shown.locator(".road svg").count() == 0
    assert not shown.locator(".player .controls").is_visible()
    assert pixels(shown, ".road", BEST) > 200
