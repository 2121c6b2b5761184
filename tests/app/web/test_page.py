"""The query window in a real browser: by keyboard, in two tabs, after a kill, and by its pixels."""

import io
import re
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image, ImageColor

from prefcal_env.study import verify
from prefcal_scenarios.style import BEST, OTHERS
from prefcal_scenarios.verification.said import Verified
from support.browser import Watched
from support.page_checks import pixels, serious
from toy_study import TOY

BLUE, ORANGE = (11, 99, 194), (185, 58, 6)
"""The curves of the two sides, in light."""


def gray(page, selector):
    """An element's picture, from 0 to 255."""
    shot = page.locator(selector).screenshot()
    return np.asarray(Image.open(io.BytesIO(shot)).convert("L")).astype(int)


def test_twelve_comparisons_by_keyboard(browser, command):
    # Answers at random contradict what GLISp expects, and it would ask more than twelve questions.
    served, watched = command(TOY, "--agent", "lhs"), Watched(browser)
    watched.open(served.link)
    assert watched.page.url.endswith("/")  # the token is not left in the address
    keys = ["ArrowLeft", "ArrowRight", "ArrowDown", "s"] * 3
    question = watched.question()
    for number, key in enumerate(keys, start=1):
        text = watched.page.inner_text("#progress-text")
        assert text == f"question {number} of 12"
        watched.page.keyboard.press(key)
        if number < len(keys):
            question = watched.question(question)
    watched.phase("over")
    watched.page.wait_for_selector("text=Open the report")
    watched.shot("over")
    state = served.state
    assert state.ended == "all compared"
    choices = []
    for closed in state.history.comparisons[1:]:
        p = closed.answer.preference
        left_won = p is not None and p != 0 and (p == -1) == closed.challenger_left
        choices.append(
            "s" if p is None else "ArrowDown" if p == 0 else "ArrowLeft" if left_won else "ArrowRight"
        )
    assert choices == keys
    watched.page.click("text=Close prefcal")
    watched.page.wait_for_selector("text=You can close this tab.")
    watched.page.wait_for_timeout(2500)  # the page would have asked again by then
    assert watched.page.text_content("#banner") == ""
    out, _ = served.process.communicate(timeout=30)
    assert served.process.returncode == 0
    assert "Report: " in out
    assert verify(served.study) == ()
    assert watched.errors == []


def test_no_request_leaves_the_machine(opened):
    served, watched = opened()
    watched.answer("ArrowLeft")
    for key in ("h", "w", "Escape", "o", "f"):
        watched.page.keyboard.press(key)
    origin = re.match(r"http://127\.0\.0\.1:\d+/", served.link)[0]
    others = [url for url in watched.requests if not url.startswith((origin, "data:", "blob:"))]
    assert others == []
    assert len(watched.requests) > 10


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_both_sides_show_their_curves(opened, theme):
    _, watched = opened(color_scheme=theme)
    watched.shot(f"question-{theme}")
    left, right = (BLUE, ORANGE) if theme == "light" else ((116, 180, 255), (255, 157, 107))
    assert pixels(watched.page, "#left-plot", left) > 400
    assert pixels(watched.page, "#right-plot", right) > 400
    assert pixels(watched.page, "#left-plot", right) == 0
    watched.page.keyboard.press("o")
    watched.page.wait_for_selector("#both-plot .js-line")
    watched.page.wait_for_timeout(200)
    assert pixels(watched.page, "#both-plot", left) > 400
    assert pixels(watched.page, "#both-plot", right) > 200
    watched.shot(f"overlay-{theme}")
    watched.page.emulate_media(color_scheme="dark" if theme == "light" else "light")
    watched.page.wait_for_timeout(300)
    assert pixels(watched.page, "#both-plot", left) == 0  # it follows the system's theme


RANGES = """div => { const l = div._fullLayout;
  return [l.xaxis.range, l.yaxis.range, l.yaxis2.range, l.shapes.length] }"""


def test_one_cursor_reads_both_sides(opened):
    _, watched = opened()
    box = watched.page.locator("#left-plot").bounding_box()
    watched.page.mouse.move(box["x"] + 200, box["y"] + 60)
    texts = [watched.page.inner_text(f"#{side}-plot output >> nth=0") for side in ("left", "right")]
    assert all(re.fullmatch(r"h = -?[\d.]+ @ [\d.]+ h", text) for text in texts)
    assert texts[0].split("@")[1] == texts[1].split("@")[1]
    watched.page.keyboard.press(".")
    assert watched.page.inner_text("#left-plot output >> nth=0") != texts[0]


def test_two_tabs_answer_the_same_question(browser, window):
    served, first = window(), Watched(browser)
    first.open(served.link)
    second = Watched(browser)
    # The second tab hears of no change, as if its long poll hung in a slow network.
    second.page.route(re.compile("/api/now.*after="), lambda route: None)
    second.open(served.link)
    question = first.question()
    first.page.keyboard.press("ArrowLeft")
    first.question(question)
    assert second.page.evaluate("() => document.body.dataset.question") == question
    second.page.keyboard.press("ArrowRight")
    second.page.wait_for_selector("#banner:not([hidden])")
    assert "nothing was recorded twice" in second.page.inner_text("#banner")
    second.question(question)  # it goes on with the open one
    assert served.state.history.answered == 2


def test_a_killed_server_goes_on_where_it_was(browser, command):
    served, watched = command(), Watched(browser)
    watched.open(served.link)
    watched.answer("ArrowLeft")
    question = watched.question()
    watched.page.keyboard.press("ArrowRight")
    watched.page.wait_for_function("() => document.getElementById('saved').textContent")
    served.kill()
    watched.page.wait_for_selector("#banner:not([hidden])")
    told = watched.page.inner_text("#banner")
    assert "It had saved 2 answers, the last one “right is better”. To continue, run: " in told
    assert "prefcal calibrate" in told
    assert verify(served.study) == ()
    assert served.state.history.answered == 3
    again = command()
    watched.page.goto(again.link)
    assert watched.question() != question
    assert watched.page.inner_text("#progress-text") == "question 3 of 12"


def test_keys_rest_while_somebody_types_and_a_long_press_answers_once(opened):
    served, watched = opened()
    watched.page.keyboard.press("c")
    watched.page.keyboard.type("quieter, so q and s")
    watched.page.keyboard.press("ArrowLeft")
    assert served.state.history.answered == 1
    watched.page.keyboard.press("Escape")
    watched.answer("ArrowRight")
    watched.page.keyboard.press("c")
    watched.page.keyboard.type("louder")
    watched.page.keyboard.press("Enter")
    watched.answer("ArrowRight")
    assert [c.comment for c in served.state.history.comparisons[1:]] == ["quieter, so q and s", "louder"]
    assert watched.page.input_value("#comment") == ""
    assert served.state.marks == {}
    question = watched.question()
    for _ in range(6):
        watched.page.keyboard.down("ArrowLeft")  # all but the first are repeats
    watched.question(question)
    watched.page.keyboard.up("ArrowLeft")
    watched.page.wait_for_timeout(300)
    assert served.state.history.answered == 4


def test_marks_are_kept_and_shown(opened):
    served, watched = opened()
    watched.page.keyboard.press("e")
    watched.page.wait_for_selector("#right.unsafe")
    watched.page.keyboard.press("a")
    watched.page.wait_for_selector("#left-good-enough[aria-pressed=true]")
    watched.shot("marks")
    watched.page.keyboard.press("a")
    watched.page.wait_for_selector("#left-good-enough[aria-pressed=false]")
    assert sorted(map(sorted, served.state.marks.values())) == [[], ["unsafe"]]


def test_what_changed_since_a_study_was_begun_is_shown_until_it_is_read(browser, window):
    served, watched = window(remarks=["Its files have changed."]), Watched(browser)
    watched.open(served.link)
    assert watched.page.inner_text("#remarks p") == "Its files have changed."
    watched.page.click("#remarks button")
    watched.answer("ArrowLeft")
    assert watched.page.is_hidden("#remarks")
    assert watched.errors == []


def test_blind_hides_what_is_which_and_does_not_even_send_it(opened):
    served, watched = opened()
    watched.page.keyboard.press("b")
    watched.page.wait_for_selector("body[data-blind=true]")
    shown = watched.page.inner_text("#pair")
    for word in ("experiment", "best so far", "new", "N_p", "gain"):
        assert word not in shown
    sent = watched.page.evaluate("fetch('/api/now?blind=1').then((r) => r.text())")
    assert '"theta":[{' not in sent
    assert "best so far" not in sent
    watched.answer("ArrowLeft")
    assert served.state.history.comparisons[1].blind


def test_history_shows_again_and_retracts(opened):
    served, watched = opened()
    time, *_ = watched.page.eval_on_selector("#left-plot", RANGES)
    watched.answer("ArrowLeft")
    watched.answer("ArrowRight")
    asked = watched.page.eval_on_selector("#left-plot", RANGES)
    watched.page.keyboard.press("h")
    watched.page.click(".answers tbody tr:last-child th button")
    watched.page.wait_for_selector("#again .right .js-line")
    watched.shot("history")
    # As it was shown: the same axes, with targets and limits.
    left, right = watched.page.eval_on_selector_all("#again .plot", f"all => all.map({RANGES})")
    assert left == right
    assert left[3] > 0
    # The question's own component: the time in which things happened there, the study's heights.
    assert left[:3] == [time, *asked[1:3]]
    assert watched.page.locator("#again .head").count() == 4
    watched.page.click(".answers tbody tr:last-child >> text=Retract")
    assert "primary" not in watched.page.get_attribute("text=Retract it", "class")
    watched.page.click("text=Retract it")
    watched.page.wait_for_selector("tr.retracted")
    assert served.state.history.comparisons[1].retracted


def test_where_are_we_shows_the_best_and_what_was_learned(opened):
    served, watched = opened()
    for key in ("ArrowLeft", "ArrowRight", "ArrowLeft"):
        watched.answer(key)
    watched.page.keyboard.press("w")
    watched.page.wait_for_selector("[data-plot=slice] .js-line")
    assert watched.page.locator("[data-plot=tried] .points path").count() >= 12
    watched.shot("where-are-we")
    page = watched.page
    assert page.input_value("#pace") == "1"
    page.focus("#pace")
    with page.expect_response("**/api/pace*") as posted:
        page.select_option("#pace", "3")
    assert posted.value.ok
    # Drawn anew, and still in focus.
    page.wait_for_function("() => document.activeElement.id === 'pace'")
    assert page.input_value("#pace") == "3"
    watched.page.click("text=Ask me an earlier question again")
    once = "() => document.getElementById('heading').textContent.startsWith('Once')"
    watched.page.wait_for_function(once)
    watched.answer("ArrowLeft")
    assert len(served.state.history.repeats) == 1


def test_one_table_compares_both_sides_and_a_key_opens_it(opened):
    _, watched = opened("overtake", n_max=5)
    page = watched.page
    assert page.is_hidden("#compare")
    page.keyboard.press("t")
    cells = "all => all.map(row => [...row.children].map(cell => cell.innerText.trim()))"
    rows = page.eval_on_selector_all("#compare tbody tr", cells)
    told = page.evaluate("fetch('/api/now').then((r) => r.json())")["question"]["comparison"]
    differing = [row for row in told if row["size"] > 0]
    assert len(rows) == len(differing) > 6
    for shown, row in zip(rows, differing, strict=True):
        assert row["left"]["text"] in shown[1]
        assert row["right"]["text"] in shown[2]
        assert shown[3] == (row["difference"] or "–")
    assert pixels(page, "#compare", BLUE) + pixels(page, "#compare", ORANGE) > 200  # bars
    watched.shot("table")
    watched.answer("ArrowLeft")
    assert page.is_visible("#compare")  # it stays, for the next question
    page.click("#compare-toggle")
    assert page.is_hidden("#compare")


def test_axes_stay_what_they_are_from_one_question_to_the_next(opened):
    """And curves that are renewed in place show what a figure made anew would show."""
    _, watched = opened(n_max=13)
    page = watched.page
    same, before = 0, None
    for _ in range(8):
        watched.answer("ArrowLeft")
        now = page.eval_on_selector("#left-plot", RANGES)
        same += now == before
        before = now
    assert same >= 2
    page.mouse.move(1, 1)
    shown = [gray(page, f"#{side}-plot") for side in ("left", "right")]
    page.reload()
    watched.question()
    page.wait_for_timeout(300)
    for one, side in zip(shown, ("left", "right"), strict=True):
        assert np.mean(np.abs(one - gray(page, f"#{side}-plot")) > 40) < 0.002


def test_time_has_a_title_and_the_tab_says_how_far_it_is(opened):
    _, watched = opened()
    page = watched.page
    assert page.locator("#left-plot .xtitle").text_content().startswith("time [h]")
    assert re.fullmatch(r"1/12 · .+ · prefcal", page.title())
    icon = page.get_attribute("link[rel=icon]", "href")
    fetched = "u => fetch(u).then((r) => [r.status, r.headers.get('content-type')])"
    assert page.evaluate(fetched, icon) == [200, "image/svg+xml"]
    watched.answer("ArrowLeft")
    assert page.title().startswith("2/12 · ")


SIZES = [(1280, 720), (1280, 560), (768, 1024), (1024, 768), (820, 1180), (960, 720), (1100, 640)]
CUT = "all => all.filter(e => e.scrollWidth > e.clientWidth).map(e => e.textContent)"


def test_curves_and_answers_fit_at_every_size(opened):
    _, watched = opened("overtake", n_max=5)
    page = watched.page
    page.click("text=Got it")  # the briefing, above the first question only
    for width, height in SIZES:
        page.set_viewport_size({"width": width, "height": height})
        page.wait_for_timeout(400)
        watched.shot(f"overtake-{width}-{height}")
        for choice in ("left", "same", "cannot-tell", "right"):
            box = page.locator(f"#verdict-{choice}").bounding_box()
            assert box["x"] + box["width"] <= width
            assert box["y"] + box["height"] <= height
        assert not page.evaluate("document.documentElement.scrollWidth > innerWidth")
        footer = page.locator("#verdicts").bounding_box()["y"]
        for side in ("left", "right"):
            figure = page.locator(f"#{side}-plot .main-svg").first.bounding_box()
            cell, card = (page.locator(f"#{at}").bounding_box() for at in (f"{side}-plot", side))
            assert figure["width"] == pytest.approx(cell["width"], abs=1)
            assert figure["y"] + figure["height"] <= card["y"] + card["height"]
            # Nothing has to be scrolled at the size that is promised.
            assert (width, height) != SIZES[0] or card["y"] + card["height"] <= footer
        assert pixels(page, "#right-plot", BLUE) == 0  # nothing of the left card
    page.set_viewport_size({"width": 820, "height": 1180})
    assert page.eval_on_selector_all("#pair .head span", CUT) == []
    page.keyboard.press("o")
    page.wait_for_selector("#both-plot .js-line")
    both, figure = (page.locator(f"#both{at}").first.bounding_box() for at in ("", "-plot .main-svg"))
    assert figure["y"] + figure["height"] <= both["y"] + both["height"]


def test_the_result_is_verified_by_a_key_and_a_person_judges_the_worst_runs(browser, command):
    served, watched = command("lag", "--agent", "lhs", n_max=2), Watched(browser, color_scheme="light")
    watched.open(served.link)
    page = watched.page
    page.keyboard.press("ArrowLeft")
    watched.phase("over")
    page.keyboard.press("v")  # while the report is being written, or after that
    page.wait_for_selector("#verification .statement")
    assert re.search(r"\d+ of 299 runs end safely", page.inner_text("#verification .statement"))
    page.click("#verified summary")
    assert "phase margin" in page.inner_text("#verification")
    page.click("#worst-runs summary")
    pictures = page.locator(".worst img")
    assert pictures.count() == 3
    pictures.first.scroll_into_view_if_needed()
    page.wait_for_function("() => document.querySelector('.worst img').naturalWidth > 300")
    for color in (BEST, OTHERS[0]):  # the nominal run, and the worst one
        assert pixels(page, ".worst img >> nth=0", ImageColor.getrgb(color)) > 100
    page.click("text=Not acceptable >> nth=0")
    page.wait_for_selector(".worst [aria-pressed=true]")
    assert serious(page) == []
    page.reload()  # what is known stays
    page.click("#worst-runs summary")
    page.wait_for_selector(".worst [aria-pressed=true]")
    assert page.inner_text(".worst [aria-pressed=true]") == "Not acceptable"
    (kept,) = served.study.parent.rglob("verification.json")
    said = Verified.read(kept.parent)
    assert [each.verdict for each in said.worst] == ["not acceptable", "", ""]
    lines = ("[kpis]", '"M_s" = {"at_most" = 2.0}')  # of a plant of one's own, to copy
    replace(said, lines=lines).write(kept.parent)
    page.reload()
    page.wait_for_selector("#verification pre")  # before what is folded
    assert page.text_content("#verification pre") == "\n".join(lines)
    assert watched.errors == []
