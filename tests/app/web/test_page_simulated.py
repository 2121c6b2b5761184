"""Everything simulated, in a real browser: the reason, the picture, a look, a request, an offer."""

import contextlib
import re
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from prefcal_agents.result import Influence, SmallerChange
from prefcal_agents.screening import findings
from prefcal_agents.screening.agent import Screening
from prefcal_agents.screening.findings import Alternative, Reason
from prefcal_app.session import Background
from prefcal_app.view import end
from prefcal_app.web import Window
from support.browser import Served, Watched
from support.interviews import begin
from support.page_checks import pixels, serious
from support.screened import let_say, screening
from support.unseen import unseen

RIGHT = (184, 56, 6)
GOOD = {"light": (23, 113, 63), "dark": (105, 207, 149)}


@pytest.fixture
def screen(tmp_path, monkeypatch):
    """Serve a study whose agent simulates, has reasons, and promises nothing after an answer."""
    let_say(monkeypatch, reason=Reason(0.7, ("final",), ("t_f",)), chance_of_better=0.08, certificate=None)
    with contextlib.ExitStack() as served:

        def start(n_max=6):
            path = tmp_path / "mine.prefcal"
            interview = screening(n_max=n_max, path=path, count=240)
            window = served.enter_context(Window(interview))
            served.enter_context(Background(interview))
            return Served(window.link, path)

        yield start


def test_a_bar_grows_while_the_first_question_is_simulated(browser, tmp_path, monkeypatch):
    # Slow until the bar was seen, however long a busy machine takes to show the page.
    hurry = tmp_path / "hurry"
    monkeypatch.setenv("PREFCAL_TEST_SECONDS", "1")
    monkeypatch.setenv("PREFCAL_TEST_HURRY", str(hurry))
    interview = begin(unseen, agent=partial(Screening, n_simulated=200))
    with Window(interview) as window, Background(interview):
        watched = Watched(browser)
        page = watched.page
        page.goto(window.link)
        page.wait_for_function("() => document.getElementById('wait-progress').value > 0")
        bar = page.locator("#wait-progress")
        assert bar.is_visible()
        assert bar.get_attribute("max") == "56"
        assert re.search(r"\d+ of 56 simulated", page.inner_text("#wait-text"))
        watched.shot("simulating-1280")
        hurry.touch()
        watched.question()
        assert watched.errors == []


def opened(browser, served, **options):
    """A page with the picture on show."""
    watched = Watched(browser, **options)
    watched.open(served.link)
    watched.page.keyboard.press("m")
    watched.page.wait_for_selector("#map .point")
    watched.page.wait_for_timeout(200)
    return watched


def chosen(page):
    """What is written about the chosen point."""
    return page.inner_text("#point h3"), page.inner_text("#point .values")


def never_shown(page):
    """Go to a point that was never shown, by keyboard."""
    page.focus("#map")
    for key in ("ArrowLeft", "ArrowDown", "ArrowRight", "ArrowUp") * 5:
        if page.inner_text("#point h3") == "Simulated, never shown":
            return chosen(page)
        page.keyboard.press(key)
    raise AssertionError("no such point was reached")


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_the_picture_shows_the_simulated_and_the_best(browser, screen, theme):
    watched = opened(browser, screen(), color_scheme=theme)
    page = watched.page
    watched.shot(f"simulated-{theme}")
    assert pixels(page, "#map", GOOD[theme]) > 60  # the star
    told = r"(\d+) simulated, 2 shown\. Not drawn: (\d+) failed, (\d+) stopped as unsafe or "
    simulated, failed, stopped = map(int, re.match(told, page.inner_text("#map-told")).groups())
    assert re.search(r"The last that failed: Ts .*no solution.* arrow keys\.", page.inner_text("#map-told"))
    gray = page.locator("#map .scatterlayer .trace").first.locator(".point")
    assert gray.count() == simulated - 2 - failed - stopped > 20
    # Plotly puts empty characters around a subscript.
    titles = [page.text_content(f"#map .{axis}title").replace("\u200b", "") for axis in "xy"]
    assert titles == ["final level: distance from its target [m]", "settling time tf [h]"]
    page.select_option("#map-x", label="gain [m/%]")
    page.wait_for_timeout(200)
    assert page.text_content("#map .xtitle") == "gain [m/%]"


def test_a_chosen_point_is_looked_at_and_records_nothing(browser, screen):
    served = screen()
    watched = opened(browser, served, color_scheme="light")
    page, before = watched.page, served.state
    assert "Experiment 2" in chosen(page)[0]  # the new one of the open question
    assert page.is_disabled("#ask-for")
    first = never_shown(page)
    page.keyboard.press("ArrowUp")  # all reach the target, so they lie above each other
    assert chosen(page) != first
    page.keyboard.press("ArrowDown")
    points = page.locator("#map .scatterlayer .trace").first.locator(".point")
    clicked = chosen(page)
    for index in (3, 4):
        box = points.nth(index).bounding_box()
        page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
        page.wait_for_timeout(100)
    assert chosen(page) != clicked
    assert page.evaluate("document.body.dataset.view") == "simulated"
    never_shown(page)
    page.click("#look-at")
    page.wait_for_selector("#look .js-line")
    assert "nothing is recorded" in page.inner_text("#look h3")
    assert page.inner_text("#look .left h4") == "Best so far"
    assert page.inner_text("#look .right .which") == "never shown"
    watched.shot("simulated-look")
    assert serious(page) == []
    assert served.state == before
    page.keyboard.press("Escape")
    watched.answer("ArrowLeft")
    page.wait_for_selector("#offer:visible")
    assert serious(page) == []


def test_it_offers_to_stop_and_going_on_is_respected(browser, screen):
    served = screen()
    watched = Watched(browser)
    watched.open(served.link)
    page = watched.page
    watched.answer("ArrowLeft")
    page.wait_for_selector("#offer:visible")
    offer = page.inner_text("#offer-text")
    assert re.fullmatch(
        r"The chance that the most promising of the \d+ simulated is better than the best so far "
        r"is 8\s%\. Stop here, or go on\?",
        offer,
    )
    watched.shot("offer")
    page.click("#offer-go-on")
    watched.answer("ArrowLeft")
    page.wait_for_timeout(500)
    assert page.is_hidden("#offer")
    page.keyboard.press("w")
    page.wait_for_selector("text=Continue or stop?")
    assert "simulated is better than the best so far is 8\xa0%" in page.inner_text("#view-status")
    page.reload()
    page.wait_for_selector("#offer:visible")
    page.click("#offer-finish")
    watched.phase("over")
    page.wait_for_function(
        "() => document.getElementById('view-over').innerText.includes('simulated is better than')"
    )
    assert page.locator("#view-over >> text=Keep comparing").is_visible()
    assert served.state.ended == "stopped"
    assert watched.errors == []


def test_the_end_leads_to_the_answer_that_matters_and_to_other_candidates(browser, screen, monkeypatch):
    decisive = Influence(1, 1, 0.3, sure=True)
    smaller = SmallerChange((0.5, 21.0, 1.0), (0, 2), 0.03)

    def told(agent, known):
        if not known.over:
            return known
        thetas = map(tuple, agent.bank.thetas[[5, 9]].tolist())
        menu = tuple(map(Alternative, thetas, (("t_f",), ("final",))))
        return replace(known, influences=(decisive,), best=0, menu=menu, smaller=smaller)

    monkeypatch.setattr(findings, "_explain_result", told)
    called(monkeypatch)
    said = end.outlook_view

    def at_an_end(outlook):
        sentences = [
            *said(outlook)["sentences"],
            "T_s is near the end of its range; widen it, for example with:",
        ]
        return (
            {"sentences": sentences, "command": "prefcal studies respace mine --knob T_s=0:2"}
            if outlook
            else None
        )

    monkeypatch.setattr(end, "outlook_view", at_an_end)
    watched = Watched(browser)
    watched.open(screen(n_max=3).link)
    page = watched.page
    watched.answer("ArrowLeft")
    page.keyboard.press("ArrowRight")
    watched.phase("over")
    page.click("text=More on what is left to gain")
    page.wait_for_selector("text=2 of 3 knobs can stay as before")
    page.click("text=Look at the smaller change")  # simulated apart from all others, and in the picture
    page.wait_for_function("() => document.querySelector('#point .values')?.textContent.includes('21')")
    assert "Simulated, never shown" in page.inner_text("#point")
    page.keyboard.press("Escape")
    page.wait_for_selector("text=The result rests on the answer about experiment 2")
    watched.shot("end-simulated-1280")
    after = "p:has-text('for example with:') + p.command >> text=studies respace"
    assert page.locator(f"#view-over {after}").is_visible()  # the command follows its sentence at once
    page.click("text=Look at that answer again")
    page.wait_for_selector("#again h3")
    assert "left is better" in page.inner_text("#again").lower()
    page.keyboard.press("Escape")
    assert page.locator("button.other").all_inner_texts() == [
        "lower settling time tf 1",
        "final level nearer to its target 2",
    ]
    page.click("button.other >> nth=1")
    page.wait_for_selector("#point h3")
    page.click("#ask-for")  # one more experiment: to choose it is to compare it
    watched.phase("question")
    page.wait_for_function("() => document.getElementById('why').textContent.includes('asked')")
    assert watched.errors == []


def called(monkeypatch):
    """Let the θ on the menu be called by what they are said to gain, whatever they cost."""
    words = {"t_f": "lower settling time t_f", "final": "final level nearer to its target"}

    def names(menu, *_):
        return [words[other.better_in[0]] for other in menu]

    monkeypatch.setattr("prefcal_app.view.end.menu_names", names)


@pytest.fixture
def menu(browser, screen, monkeypatch):
    """The end of a study whose menu names two others."""

    def told(agent, known):
        bank, best = agent.bank, agent.bank.find(agent.best)
        shown = {best, *bank.rows([sample.theta for sample in agent.history.samples])}
        usable = np.setdiff1d(np.flatnonzero(np.isfinite(bank.kpis).all(axis=1)), list(shown))
        first, *_, last = usable[np.argsort(bank.kpis[usable, bank.names.index("t_f")])].tolist()
        thetas = map(tuple, bank.thetas[[first, last]].tolist())
        return replace(known, menu=tuple(map(Alternative, thetas, (("t_f",), ("final",)))))

    monkeypatch.setattr(findings, "_explain_result", told)
    called(monkeypatch)
    served = screen(n_max=3)

    def ended(**options):
        watched = Watched(browser, **options)
        watched.open(served.link)
        watched.answer("ArrowLeft")
        watched.page.keyboard.press("ArrowRight")
        watched.phase("over")
        watched.page.wait_for_selector("button.other")
        return watched

    return served, ended


def test_a_long_name_on_the_menu_is_read_in_full_on_a_phone(menu, monkeypatch):
    long = (
        "lower settling time of level (within ±5 %), but higher peak error of level under the load",
        "other",
    )
    monkeypatch.setattr("prefcal_app.view.end.menu_names", lambda *_: long)
    watched = menu[1](viewport={"width": 390, "height": 844})
    box = watched.page.locator("button.other").first.bounding_box()
    assert box["x"] + box["width"] <= 390
    watched.shot("menu-390")


def test_one_key_looks_at_another_candidate_and_one_chooses_it(menu):
    served, ended = menu
    watched = ended(color_scheme="light")
    page, before = watched.page, served.state
    page.keyboard.press("c")  # nothing is looked at yet
    page.keyboard.press("2")
    page.wait_for_selector("#look .js-line")
    page.wait_for_selector("#choose:enabled")
    assert page.evaluate("document.body.dataset.view") == "simulated"
    assert page.inner_text("#look .left h4") == "Best so far"
    assert pixels(page, "#look .right .plot", RIGHT) > 60  # its curves
    assert served.state == before
    theta = page.inner_text("#look .right .theta")
    page.keyboard.press("c")
    page.keyboard.press("c")  # a double press chooses once
    page.wait_for_selector("#view-over h3 >> text=The result: experiment 4")
    heads = page.locator("#view-over h3").all_inner_texts()  # it has no report to verify
    assert heads == ["The result: experiment 4", "What you got", "What next?", "Why this one"]
    assert page.is_hidden("#banner")
    assert served.state.ended == "all compared"
    assert page.locator("#view-over >> text=Keep comparing").count() == 0  # nothing is left to compare
    assert len(served.state.history.comparisons) == len(before.history.comparisons) + 1
    assert served.state.requested == {3}
    for value in re.findall(r"[\d.]+", page.inner_text("#view-over .values")):
        assert f"{float(value):.3g}" in theta  # the result has all digits, a look has three
    page.keyboard.press("z")  # undone as any answer
    watched.phase("question")
    assert watched.errors == []


def test_a_slider_shows_what_lies_between_and_the_stop_on_show_is_chosen(menu):
    served, ended = menu
    watched = ended()
    page = watched.page
    page.keyboard.press("1")
    page.wait_for_selector("#choose:enabled")
    assert page.get_attribute("#way", "aria-valuetext").endswith("to lower settling time t_f")
    stops = int(page.get_attribute("#way", "max"))
    assert stops >= 2
    page.focus("#way")
    seen, images = set(), set()
    for _ in range(stops):
        page.keyboard.press("ArrowRight")
        words = page.get_attribute("#way", "aria-valuetext")
        if words == "the result":
            assert page.is_disabled("#choose")
            assert page.inner_text("#look") == ""
            continue
        page.wait_for_selector("#choose:enabled")
        seen.add(page.inner_text("#look .right .theta"))
        images.add(page.locator("#look .right .plot").screenshot())
        assert page.evaluate("document.activeElement.id") == "way"
    assert len(seen) == len(images) == stops - 1
    assert page.get_attribute("#way", "aria-valuetext").endswith("final level nearer to its target")
    assert serious(page) == []
    for width, height in ((1280, 800), (640, 400), (390, 780)):
        page.set_viewport_size({"width": width, "height": height})
        page.wait_for_timeout(300)
        watched.shot(f"slider-{width}")
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        assert page.evaluate("() => document.getElementById('main').scrollWidth <= innerWidth")
        for part, share in (("#way", 0.6), ("#map", 0.4)):
            page.locator(part).scroll_into_view_if_needed()
            box = page.locator(part).bounding_box()
            assert 0 <= box["x"] < box["x"] + box["width"] <= width
            assert box["width"] > share * width
    page.click("#choose")
    page.wait_for_selector("#view-over h3 >> text=The result: experiment 4")
    assert served.state.requested == {3}
    assert watched.errors == []


def test_nothing_of_it_is_there_for_other_agents(browser, window):
    watched = Watched(browser)
    watched.open(window().link)
    page = watched.page
    assert page.is_hidden("#to-simulated")
    assert page.is_hidden("#why")
    page.keyboard.press("m")
    assert page.evaluate("document.body.dataset.view") == "now"
    page.keyboard.press("?")
    page.wait_for_selector(".keys")
    assert "simulated" not in page.inner_text(".keys")
    assert not any("/api/simulated" in url for url in watched.requests)
