"""A run that never returns, in a real browser: stopped, counted as failed, and gone on."""

from pathlib import Path

from support.browser import Watched, serve

HANGS = Path(__file__).parents[2] / "support" / "wild_runs.py"


def test_a_run_that_hangs_is_stopped_on_the_page(tmp_path, browser):
    served = serve(tmp_path, f"{HANGS}:hangs", "--seed", "5", "--n-init", "3")
    try:
        watched = Watched(browser)
        page = watched.page
        page.goto(served.link)
        page.wait_for_selector("#stop-run:visible")
        assert page.inner_text("#wait-title") == "Running experiment 1"
        assert "A run is stopped after 1 h (--run-timeout)" in page.inner_text("#stop-text")
        watched.shot("stop-run")
        page.click("#stop-run")
        watched.phase("failed")
        assert "you stopped the run after" in page.inner_text("#view-failed .problem")
        page.click("button:text('Count it as failed')")
        watched.phase("question")
        assert watched.errors == []
    finally:
        served.stop()
