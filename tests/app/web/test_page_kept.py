"""What a person has typed or pressed is not lost by reload, Back or a lost connection."""


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
