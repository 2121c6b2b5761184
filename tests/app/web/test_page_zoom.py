"""What part of the curves is in sight: the time shown, what stays zoomed, and small screens."""

import pytest

from prefcal_env.experiments.experiment import Channel
from prefcal_env.plants.plant import Plant
from prefcal_scenarios.described.pid_scenario import pid_scenario
from support.browser import Watched
from support.page_checks import pixels

BLUE, ORANGE = (11, 99, 194), (185, 58, 6)
AXES = """() => [...document.querySelectorAll("#left-plot, #right-plot")].map((div) =>
  [div._fullLayout.xaxis.range, div._fullLayout.yaxis.range])"""
CUT = """() => [...document.querySelectorAll(".which, .head span, .buttons, .compare td")]
  .filter((e) => e.offsetParent && e.scrollWidth > e.clientWidth).map((e) => e.textContent)"""
NEAREST = """selector => Math.min(...[...document.querySelectorAll(selector)].flatMap((row) => {
  const shown = [...row.querySelectorAll("td")].flatMap((cell) => {
    const range = document.createRange(), span = cell.querySelector("span") ?? cell;
    range.selectNodeContents(span.firstChild?.nodeType === 3 ? span.firstChild : span);
    return [...range.getClientRects()].filter(({ width }) => width > 1);
  });
  return shown.flatMap((a) => shown.filter((b) => b.left > a.left && b.top < a.bottom && a.top < b.bottom)
    .map((b) => b.left - a.right));
}))"""
"""The least distance between the values beside each other in rows of a table."""
NOW = "fetch('/api/now').then((r) => r.json())"


def axes(watched):
    """The axes of both sides, which are the same."""
    left, right = watched.page.evaluate(AXES)
    assert left == right
    return left


def shown(watched):
    """What the server says of the open question."""
    return watched.page.evaluate(NOW)["question"]


def test_the_first_thing_in_sight_is_the_time_in_which_things_happen(opened):
    _, watched = opened()
    whole = shown(watched)["axes"]["x"]
    x, y = axes(watched)
    assert x == pytest.approx(shown(watched)["windows"][0])
    assert x[1] - x[0] < 0.8 * (whole[1] - whole[0])
    assert y == shown(watched)["axes"]["y"][0]  # a height means the same in every question
    assert watched.page.get_attribute("#zoom", "aria-pressed") == "false"
    title = watched.page.locator("#left-plot .xtitle").text_content()
    assert title == "time [h] · key 0: all of the time"
    watched.page.keyboard.press("0")
    assert axes(watched)[0] == whole
    assert watched.page.locator("#left-plot .xtitle").text_content() == "time [h]"
    watched.page.keyboard.press("0")
    assert axes(watched)[0] == x


def test_two_events_hours_apart_are_shown_one_after_the_other(opened):
    valve, T = Channel("valve", "%", 0, 100), Channel("T", "°C")
    plant = Plant.of(([1.6], [40.0, 1.0]), delay=7.0, inputs=[valve], outputs=[T])
    _, watched = opened(pid_scenario(plant, reference={"T": 100.0}, horizon=28_800.0))
    page, question = watched.page, shown(watched)
    step, load = question["windows"]
    assert step[0] == 0
    assert step[1] <= 1500
    assert 14_000 < load[0] <= 14_400 < load[1] < 16_000
    title = page.locator("#left-plot .xtitle")
    assert axes(watched)[0] == pytest.approx(step)
    assert title.text_content() == f"time [s] · key 0: moves again from {load[0]:.0f} s"
    page.keyboard.press("0")
    assert axes(watched)[0] == pytest.approx(load)
    assert title.text_content() == "time [s] · key 0: all of the time"
    page.keyboard.press("0")
    assert axes(watched)[0] == question["axes"]["x"]
    page.keyboard.press("0")
    assert axes(watched)[0] == pytest.approx(step)
    page.keyboard.press("f")
    assert axes(watched)[0] == pytest.approx(step)
    assert title.text_content() == "time [s] · key 0: all of the time"
    page.keyboard.press("0")
    assert axes(watched)[0] == question["axes"]["x"]
    page.keyboard.press("0")
    page.keyboard.press("0")
    assert axes(watched)[0] == pytest.approx(load)
    for _ in range(9):  # what comes first is on the screen whenever an answer is asked for
        watched.answer("ArrowLeft")
        windows = shown(watched)["windows"]
        assert axes(watched)[0] == pytest.approx(windows[0])
        if len(windows) == 2:
            break
    assert "moves again from" in title.text_content()


def test_what_is_zoomed_stays_for_the_next_question_and_after_a_reload(opened):
    _, watched = opened()
    page = watched.page
    page.keyboard.press("f")
    near = [pytest.approx(2 - 8 * 0.06), pytest.approx(2 + 8 * 0.06)]
    assert axes(watched)[1] == near
    watched.answer("ArrowLeft")
    assert axes(watched)[1] == near
    page.reload()
    watched.question()
    assert axes(watched)[1] == near
    assert page.get_attribute("#zoom", "aria-pressed") == "true"
    page.keyboard.press("f")
    page.keyboard.press("0")
    watched.answer("ArrowRight")
    page.reload()
    watched.question()
    assert axes(watched)[0] == shown(watched)["axes"]["x"]


def test_a_part_that_was_dragged_stays_too(opened):
    _, watched = opened()
    page = watched.page
    box = page.locator("#left-plot .nsewdrag").first.bounding_box()
    page.mouse.move(box["x"] + 40, box["y"] + 20)
    page.mouse.down()
    page.mouse.move(box["x"] + 160, box["y"] + 60, steps=4)
    page.mouse.up()
    page.wait_for_timeout(300)
    dragged = axes(watched)
    assert dragged[0] != pytest.approx(shown(watched)["windows"][0])
    watched.answer("ArrowLeft")
    assert axes(watched) == dragged
    page.reload()
    watched.question()
    assert axes(watched) == dragged
    page.keyboard.press("f")  # back to where things happen
    assert axes(watched)[0] == pytest.approx(shown(watched)["windows"][0])


def test_captions_name_the_band_and_the_limits_that_are_drawn_and_no_others(opened):
    _, watched = opened()
    page = watched.page
    captions = lambda: page.locator("#left-plot .head > span").all_inner_texts()  # noqa: E731
    high = shown(watched)["axes"]["y"][0]
    bottom = page.locator("#left-plot .nsewdrag").first.bounding_box()["height"]
    thick = 2 * 0.06 * bottom / (high[1] - high[0]) >= 3
    assert ("± 0.06" in captions()[0]) == thick
    assert "target 2" in captions()[0]
    assert "limits 0 to 10" in captions()[1]
    page.keyboard.press("f")
    assert "target 2 ± 0.06" in captions()[0]
    box = page.locator("#left-plot .nsewdrag").nth(1).bounding_box()
    page.mouse.move(box["x"] + 40, box["y"] + 0.4 * box["height"])
    page.mouse.down()
    page.mouse.move(box["x"] + 160, box["y"] + 0.6 * box["height"], steps=4)
    page.mouse.up()
    page.wait_for_timeout(300)
    assert "limit" not in captions()[1]  # both lines are outside


def seen_above_the_answers(watched, figure):
    """The panels of a figure that are whole between the buttons above and the answers, in px."""
    page = watched.page
    top = page.locator("main").bounding_box()["y"]
    footer = page.locator("#verdicts").bounding_box()["y"]
    boxes = [p.bounding_box() for p in page.locator(f"{figure} .nsewdrag").all()]
    return [b["height"] for b in boxes if b["y"] >= top and b["y"] + b["height"] <= footer]


@pytest.mark.parametrize("scenario", ["cstr", "overtake"])
def test_at_200_percent_a_whole_panel_of_both_runs_is_above_the_answers(browser, window, scenario):
    served = window(scenario, n_max=5)
    zoomed = {"viewport": {"width": 640, "height": 360}, "device_scale_factor": 2}
    watched = Watched(browser, **zoomed)
    watched.open(served.link)  # the first question, with its task
    watched.shot(f"zoom-200-{scenario}")
    for side in ("left", "right"):
        heights = seen_above_the_answers(watched, f"#{side}-plot")
        assert len(heights) >= 1
        assert min(heights) >= 90
    assert pixels(watched.page, "#left-plot", BLUE) > 400
    assert pixels(watched.page, "#right-plot", ORANGE) > 400
    page = watched.page
    for choice in ("left", "same", "cannot-tell", "right"):
        box = page.locator(f"#verdict-{choice}").bounding_box()
        assert 0 <= box["x"] <= box["x"] + box["width"] <= 640
        assert box["y"] + box["height"] <= 360
    assert not page.evaluate("document.documentElement.scrollWidth > innerWidth")
    page.keyboard.press("t")
    page.eval_on_selector("#compare td", "td => { td.firstChild.data = '−0.0004272 N m s/rad' }")
    assert page.evaluate(CUT) == []
    page.keyboard.press("t")
    page.keyboard.press("o")
    page.wait_for_selector("#both-plot .js-line")
    assert max(seen_above_the_answers(watched, "#both-plot")) >= 90
    watched.answer("ArrowLeft")
    assert len(seen_above_the_answers(watched, "#both-plot")) >= 1


@pytest.mark.parametrize("size", [(390, 844), (360, 640)])
def test_on_a_phone_a_whole_panel_with_both_runs_is_above_the_answers(browser, window, size):
    served = window("cstr", n_max=5)
    phone = {"viewport": {"width": size[0], "height": size[1]}, "has_touch": True}
    watched = Watched(browser, **phone, is_mobile=True, device_scale_factor=2)
    watched.open(served.link)
    page = watched.page
    page.wait_for_selector("#intro:not([hidden])")
    page.wait_for_timeout(300)
    assert len(seen_above_the_answers(watched, "#both-plot")) >= 1
    readable = "p => p.scrollHeight <= p.clientHeight || getComputedStyle(p).overflowY === 'auto'"
    assert page.eval_on_selector("#intro p", readable)
    page.click("text=Got it")
    page.wait_for_timeout(300)
    watched.shot(f"phone-{size[1]}")
    top, footer = (page.locator(at).bounding_box() for at in (".top", "#verdicts"))
    assert top["height"] + footer["height"] < 190
    assert page.locator("kbd:visible, .by-key:visible").count() == 0
    assert "31.08\xa0h ✓" in page.inner_text("#left-numbers")
    assert "≤\xa048\xa0h" in page.inner_text("#left-numbers")  # the limit that ✓ is about
    choices = ("left", "same", "cannot-tell", "right")
    tops = [page.locator(f"#verdict-{c}").bounding_box()["y"] for c in choices]
    assert max(tops) - min(tops) < 3  # one row
    assert not page.evaluate("document.documentElement.scrollWidth > innerWidth")
    assert page.is_visible("#undo")
    heights = seen_above_the_answers(watched, "#both-plot")
    assert len(heights) >= (3 if size[1] > 800 else 1)
    assert min(heights) >= 90  # 65 were too low to read
    assert pixels(page, "#both-plot", BLUE) > 400
    assert pixels(page, "#both-plot", ORANGE) > 300
    fill = lambda: page.eval_on_selector("#verdict-right", "b => getComputedStyle(b).background")  # noqa: E731
    untouched = fill()
    page.hover("#verdict-right")  # as after a tap on it
    assert fill() == untouched  # the next question does not look answered


def test_on_a_phone_the_numbers_of_a_row_do_not_touch(browser, window):
    watched = Watched(browser, viewport={"width": 390, "height": 844})
    watched.open(window("servo", n_max=3).link)
    page = watched.page
    page.keyboard.press("t")
    page.wait_for_selector("#compare:not([hidden]) td")
    assert page.evaluate(NEAREST, "#compare tbody tr") >= 6
    watched.shot("phone-table")
    watched.answer("ArrowLeft")
    page.keyboard.press("ArrowRight")
    watched.phase("over")
    page.wait_for_selector(".gain td")
    assert page.evaluate(NEAREST, ".gain tbody tr") >= 6  # 3 before
    watched.shot("phone-gain")
    assert page.evaluate("document.getElementById('main').scrollWidth <= innerWidth")


def test_magnified_to_the_limit_the_page_scrolls_as_a_whole(opened):
    _, watched = opened("cstr", n_max=5, viewport={"width": 320, "height": 256}, device_scale_factor=4)
    page = watched.page
    page.locator("#both-plot .nsewdrag").first.scroll_into_view_if_needed()
    box = page.locator("#both-plot .nsewdrag").first.bounding_box()
    assert box["y"] >= 0
    assert box["y"] + box["height"] <= 256
    assert not page.evaluate("document.documentElement.scrollWidth > innerWidth")


def test_the_head_shows_the_three_kpis_that_differ_most_in_this_pair(opened):
    _, watched = opened("cstr", n_max=5)
    for _ in range(2):
        rows = shown(watched)["comparison"]
        most = [row["title"].replace("_", "") for row in rows[:3]]
        assert all(row["size"] > 0 for row in rows[:3])
        for side in ("left", "right"):
            told = watched.page.locator(f"#{side}-numbers dt").all_text_contents()
            assert [text.replace("±3\u00a0%", "±3 %") for text in told] == most
            values = watched.page.locator(f"#{side}-numbers dd").all_inner_texts()
            assert all(row[side]["text"] in v for row, v in zip(rows, values, strict=False))
        watched.answer("ArrowLeft")


@pytest.mark.parametrize(("width", "height"), [(640, 360), (390, 560)])
def test_a_question_has_one_scroll_bar_when_magnified_and_on_a_phone(browser, command, width, height):
    watched = Watched(browser, viewport={"width": width, "height": height})
    watched.open(command(n_max=3).link)
    scrolls = "e => e.scrollHeight > e.clientHeight"
    assert watched.page.eval_on_selector("#main", scrolls)
    assert not watched.page.eval_on_selector("html", scrolls)
