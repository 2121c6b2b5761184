"""The briefing, the end, and the small ways back, in a real browser."""

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
    served, watched = command(n_max=3), Watched(browser)
    watched.open(served.link)
    watched.answer("ArrowRight")
    watched.page.keyboard.press("ArrowRight")
    watched.phase("over")
    page = watched.page
    page.fill("#more", "1")  # while the report is being written
    page.wait_for_selector("text=Open the report")
    page.keyboard.type("2")
    assert page.input_value("#more") == "12"
    assert page.locator("button.primary").filter(visible=True).count() == 0
    assert "gained" in page.inner_text("#view-over .gain").lower()
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
    assert served.state.n_max == 5


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
