"""The briefing, the end, ways back, and what is kept, in a real browser."""

import re

from support.browser import Watched


def test_the_reactor_is_explained_above_its_first_question_and_under_the_key(opened):
    _, watched = opened("cstr", n_max=3)
    page = watched.page
    page.wait_for_selector("#intro:not([hidden])")
    assert "A stirred-tank reactor is brought" in page.inner_text("#intro")
    about = page.get_attribute("#left .theta div >> nth=1", "title")
    assert about.startswith("Prediction horizon")
    page.keyboard.press("?")
    page.wait_for_selector("#dialog[open] .words")
    told = page.inner_text("#dialog")
    assert "found no solution of its optimization problem" in told
    assert "2 questions, about 1 minute" in told
    assert "undo the last answer" in told
    watched.shot("brief-1280")
    page.keyboard.press("Escape")
    page.click("text=Got it")
    page.wait_for_selector("#intro", state="hidden")
    watched.answer("ArrowLeft")
    assert page.is_hidden("#intro")


def test_the_end_shows_the_gain_and_opens_the_report(browser, command):
    served, watched = command(n_max=2), Watched(browser)
    watched.open(served.link)
    new = "new" in watched.page.inner_text("#left-which")
    watched.page.keyboard.press("ArrowLeft" if new else "ArrowRight")
    watched.phase("over")
    page = watched.page
    page.fill("#more", "1")  # while the report is being written
    page.wait_for_selector("text=Open the report")
    page.keyboard.type("2")
    assert page.input_value("#more") == "12"
    assert page.locator("button.primary").filter(visible=True).count() == 0
    assert page.inner_text("#view-over .gain h3") == "What you got"
    assert page.inner_text("#view-over .hero .faint") == "2 experiments, 1 comparison."
    assert page.locator("#view-over details[open]").count() == 0
    # Before and after over each other, in colors, dashes and words.
    assert page.inner_text("#view-over .legend").split("\n") == ["first experiment (1)", "best (2)"]
    page.wait_for_function("document.querySelectorAll('.gain .plot path.js-line').length >= 4")
    told = page.get_attribute("#view-over .gain .plot", "aria-label")
    assert re.match(r"best \(2\): level <h>: from .*first experiment \(1\): level <h>: from ", told)
    watched.shot("end-1280")
    with page.expect_popup() as opened:
        page.click("text=Open the report")
    report = opened.value
    report.wait_for_selector("h1")
    assert report.url.endswith("/report/report.html")
    # In its sandbox it is a stranger: nothing of the study can be asked for.
    asked = "fetch('/api/now').then((r) => r.status, (e) => String(e.name))"
    assert report.evaluate(asked) == "TypeError"
    with page.expect_download() as saved:
        page.click("text=Download best.json")
    assert saved.value.suggested_filename == "best.json"
    assert '"theta"' in saved.value.path().read_text(encoding="utf-8")
    assert watched.errors == []
    page.fill("#more", "2")
    page.click("text=more experiments")
    watched.question()
    assert served.state.n_max == 4


def test_undo_brings_the_comment_back(opened):
    _, watched = opened()
    watched.page.fill("#comment", "it swings")
    watched.page.keyboard.press("Enter")
    before = watched.answer("ArrowLeft")
    assert watched.page.input_value("#comment") == ""
    watched.page.keyboard.press("z")
    watched.question(before)
    watched.page.wait_for_function("() => document.getElementById('comment').value === 'it swings'")


def test_a_repeat_can_be_skipped_and_names_no_best(opened):
    served, watched = opened()
    page = watched.page
    for _ in range(2):
        watched.answer("ArrowLeft")
    for leave in (lambda: page.keyboard.press("Escape"), lambda: page.click("#skip")):
        open_one = watched.question()
        assert page.is_hidden("#skip")
        page.keyboard.press("p")
        again = watched.question(open_one)
        assert page.inner_text("#heading").startswith("Once more")
        assert "best so far" not in page.inner_text("#pair")
        watched.shot("repeat-1280")
        leave()
        watched.question(again)
        assert "best so far" in page.inner_text("#pair")
    assert served.state.history.repeats == ()


def test_a_half_typed_comment_survives_a_reload_and_belongs_to_its_question(opened):
    served, watched = opened()
    page = watched.page
    page.keyboard.press("c")
    page.keyboard.type("quieter, but")
    page.reload()
    watched.question()
    assert page.input_value("#comment") == "quieter, but"
    watched.answer("ArrowLeft")
    page.reload()
    watched.question()
    assert page.input_value("#comment") == ""
    assert served.state.history.comparisons[1].comment == "quieter, but"


def test_back_leads_to_the_question(opened):
    _, watched = opened()
    page = watched.page
    link = page.url
    page.keyboard.press("c")
    page.keyboard.type("half a thought")
    page.keyboard.press("Escape")
    for key in ("h", "w"):
        page.keyboard.press(key)
    page.wait_for_selector("#view-status:not([hidden])")
    for view in ("history", "question"):
        page.evaluate("history.back()")
        page.wait_for_selector(f"#view-{view}:not([hidden])")
    assert (page.url, page.input_value("#comment")) == (link, "half a thought")


def test_offline_the_page_says_which_answer_is_saved_and_which_is_not(opened):
    served, watched = opened()
    page = watched.page
    watched.answer("ArrowLeft")
    question = watched.answer("ArrowRight")
    page.context.set_offline(True)
    page.keyboard.press("c")
    page.keyboard.type("why")
    page.keyboard.press("Enter")
    page.keyboard.press("ArrowDown")
    page.wait_for_selector("#banner:not([hidden])")
    page.wait_for_timeout(1500)  # the page asks again meanwhile
    told = page.inner_text("#banner")
    assert "It had saved 2 answers, the last one “right is better”." in told
    assert "Not saved, as far as this page knows: “about the same”, which you pressed last." in told
    assert served.state.history.answered == 3
    page.context.set_offline(False)
    page.wait_for_function(
        "() => document.getElementById('banner').textContent.includes('Please answer again')"
    )
    assert "“about the same” was not saved" in page.inner_text("#banner")
    assert page.input_value("#comment") == "why"
    watched.answer("ArrowDown")
    assert page.is_hidden("#banner")
    assert watched.page.evaluate("document.body.dataset.question") != question
    assert served.state.history.comparisons[3].comment == "why"


def test_an_answer_whose_reply_was_lost_is_told_to_be_saved(opened):
    served, watched = opened()
    page = watched.page
    question = watched.question()

    def lose(route):
        route.fetch()  # it arrives, and its reply does not
        route.abort()

    page.route("**/api/answer*", lose)
    page.keyboard.press("ArrowLeft")
    watched.question(question)
    page.wait_for_function("() => document.getElementById('saved').textContent")
    assert page.inner_text("#saved") == "✓ saved: left is better"
    assert served.state.history.answered == 2


DRAWN = """async ([low, high]) => {
    const { tried } = await import("/static/miniature.js");
    const div = document.body.appendChild(document.createElement("div"));
    div.style.width = "400px";
    tried(div, { name: "K_p", unit: "", scale: "log10", low, high }, 0, []);
    return [...div.querySelectorAll(".ytick text")].map((tick) => tick.textContent);
}"""


def test_the_ticks_of_less_than_two_decades_keep_their_power_of_ten(opened):
    _, watched = opened()
    assert watched.page.evaluate(DRAWN, [0.32, 8.1]) == ["0.5", "1", "2", "5"]
    assert watched.page.evaluate(DRAWN, [1.8, 45]) == ["2", "5", "10", "20", "50"]
    assert watched.page.evaluate(DRAWN, [0.01, 100]) == ["0.01", "0.1", "1", "10", "100"]
