"""What a checker of accessibility (axe) finds on every view of the page: nothing serious."""

from support.browser import Watched
from support.page_checks import serious


def test_nothing_serious_is_found_on_any_view(browser, command):
    served = command("cstr", "--agent", "glisp", n_max=5)
    watched = Watched(browser, color_scheme="light")
    page = watched.page
    watched.open(served.link)
    views = {"question": serious(page)}
    for name, keys in {
        "marked": "qe",
        "overlay": "o",
        "blind": "b",
        "side by side": "bo",
        "keys": "?",
    }.items():
        for key in keys:
            page.keyboard.press(key)
            page.wait_for_timeout(350)
        views[name] = serious(page)
    page.keyboard.press("Escape")
    watched.answer("Shift+ArrowLeft")
    watched.answer("ArrowRight")
    page.keyboard.press("h")
    page.click(".answers tbody tr:last-child th button")
    page.wait_for_selector("#again .js-line")
    views["history"] = serious(page)
    page.keyboard.press("w")
    page.wait_for_selector("[data-plot=tried] .points path")
    views["where are we"] = serious(page)
    page.keyboard.press("Escape")
    watched.answer("ArrowLeft")
    page.keyboard.press("s")
    watched.phase("over")
    page.wait_for_selector("text=Open the report")
    views["over"] = serious(page)
    assert {name: found for name, found in views.items() if found} == {}


def test_the_question_is_told_to_a_screen_reader(opened):
    _, watched = opened()
    page = watched.page
    page.wait_for_function("() => document.getElementById('status').textContent")
    assert "question 1 of 12" in page.inner_text("#status")
    label = page.get_attribute("#left-plot", "aria-label")
    assert "level <h>: from" in label
    assert "the band around 2" in label
    watched.answer("ArrowLeft")
    page.wait_for_function("() => document.getElementById('status').textContent.includes('question 2 of')")


def test_everything_is_reached_by_tab(opened):
    _, watched = opened()
    reached = set()
    for _ in range(40):
        watched.page.keyboard.press("Tab")
        focused = "() => document.activeElement.id || document.activeElement.tagName"
        reached.add(watched.page.evaluate(focused))
    verdicts = ["verdict-left", "verdict-cannot-tell", "verdict-right"]
    others = ["to-history", "undo", "zoom", "left-unsafe", "right-good-enough", "comment", "finish"]
    for id_ in (*verdicts, *others):
        assert id_ in reached or watched.page.is_disabled(f"#{id_}"), id_
