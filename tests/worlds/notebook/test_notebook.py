"""A study beside a notebook: asked on the page, in a frame, and answered there."""

import os
import threading
import time
from contextlib import contextmanager
from dataclasses import replace
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import httpx
import pytest

from prefcal_app import ask
from prefcal_app.session import actions
from prefcal_app.worlds import notebook as asking_module
from prefcal_env.errors import SettingsError, StudyError
from support.browser import SHOTS
from support.calibrated import without_figures
from toy_study import toy_scenario

QUICK = {"agent": "random", "n_max": 4}


@pytest.fixture(autouse=True)
def _here(monkeypatch, tmp_path):
    without_figures(monkeypatch)
    monkeypatch.chdir(tmp_path)


def question(client):
    """Wait for a question; return it, or None at the end."""
    for _ in range(400):
        now = client.get("/api/now").json()
        if now["phase"] == "question":
            return now["question"]
        if now["phase"] == "over":
            return None
        time.sleep(0.05)
    raise AssertionError("no question")


def answer(client, choice="right"):
    """Wait for a question and answer it; return False if the study is over."""
    shown = question(client)
    if shown is None:
        return False
    body = {"question": shown["id"], "choice": choice, "comment": "", "blind": False}
    assert client.post("/api/answer", json=body).status_code == 200
    return True


@contextmanager
def page_of(asking):
    """Open the page's link as a browser does; yield a client with its cookie."""
    origin = asking.link.partition("/open/")[0]
    with httpx.Client(base_url=origin, headers={"origin": origin}) as client:
        assert client.get(asking.link).status_code == 200
        yield client


def test_answers_on_the_page_reach_the_notebook(tmp_path):
    with ask(toy_scenario(), study="./mine.prefcal", **QUICK) as asking:
        assert asking.best is None or asking.to_frame(answers=True).shape[0] == 0
        with page_of(asking) as client:
            while answer(client):
                pass
        assert asking.wait(30)
        assert len(asking.to_frame()) == 4
        assert len(asking.to_frame(answers=True)) == 3
        assert list(asking.best) == ["T_s", "N_p", "gain"]
        assert (asking.report() / "report.html").is_file()
        assert repr(asking) == "<study ./mine.prefcal: 4 experiments, 3 answers>"
    with pytest.raises(httpx.ConnectError):
        httpx.get(asking.link)


def test_only_pages_of_this_machine_may_frame_it():
    with ask(toy_scenario(), study="./mine.prefcal", **QUICK) as asking:
        headers = httpx.get(asking.link).headers
        policy = headers["content-security-policy"]
        assert "frame-ancestors http://127.0.0.1:* http://localhost:*" in policy
        assert "x-frame-options" not in headers
        assert "SameSite=Strict" in headers["set-cookie"]
        assert httpx.get(f"{asking.link.partition('/open/')[0]}/api/now").status_code == 401


def test_a_calibrator_answers_by_itself_and_the_controller_is_there():
    with ask("cstr", agent="random", n_max=3, calibrator="synthetic") as asking:
        assert asking.wait(120)
        assert asking.over
        assert asking.study is None
        assert asking.controller().T_s == pytest.approx(asking.best["T_s"])


def test_a_cell_that_runs_again_goes_on_with_its_study():
    first = ask(toy_scenario(), study="./mine.prefcal", **QUICK)
    with page_of(first) as client:
        assert answer(client, "left")
    with ask(toy_scenario(), study="./mine.prefcal", **QUICK) as second:
        assert len(second.to_frame(answers=True)) == 1
        assert second.link != first.link


def test_what_a_run_raises_is_raised_by_wait():
    def run(theta, *, seed=0):
        raise OSError("the pump does not answer")

    broken = replace(toy_scenario(), run=run)
    asking = ask(broken, calibrator="synthetic", **QUICK)
    with pytest.raises(Exception, match="the pump does not answer"):
        asking.wait(30)
    asking.close()


def reported(asking, name):
    """A file of the report as it is on the disk."""
    return (asking._work.claim.folder / name).read_text(encoding="utf-8")


def test_a_study_that_goes_on_is_not_over_and_gets_a_new_report_at_its_new_end():
    with ask(toy_scenario(), study="./mine.prefcal", **QUICK) as asking, page_of(asking) as client:
        while answer(client):
            pass
        assert asking.wait(30)
        assert len(reported(asking, "comparisons.csv").splitlines()) == 1 + 3
        asking._interview.do(actions.GoOn(2))
        assert not asking.over
        assert not asking.wait(0.1)
        while answer(client):
            pass
        assert asking.wait(30)
        assert len(reported(asking, "comparisons.csv").splitlines()) == 1 + 5


def test_close_wakes_whoever_waits_for_a_person():
    asking = ask(toy_scenario(), study="./mine.prefcal", **QUICK)
    found = []
    waiting = threading.Thread(target=lambda: found.append(asking.wait()), daemon=True)
    waiting.start()
    time.sleep(0.2)
    asking.close()
    waiting.join(10)
    assert found == [False]
    assert asking.wait() is False


def test_a_run_that_outlives_close_is_no_problem(monkeypatch):
    monkeypatch.setattr(asking_module, "_LAST_RUN", 0.2)
    started, go = threading.Event(), threading.Event()
    toy = toy_scenario()

    def run(theta, *, seed=0):
        started.set()
        assert go.wait(30)
        return toy.run(theta, seed=seed)

    asking = ask(replace(toy, run=run), calibrator="synthetic", **QUICK)
    (watch,) = (t for t in threading.enumerate() if t.name == "report")
    assert started.wait(30)
    asking.close()
    go.set()
    watch.join(10)
    assert not watch.is_alive()
    assert asking.wait(10) is False


def test_close_records_a_run_that_ends_soon_and_starts_no_other():
    begun, go = [], threading.Event()
    toy = toy_scenario()

    def run(theta, *, seed=0):
        begun.append(theta)
        assert go.wait(30)
        return toy.run(theta, seed=seed)

    options = {**QUICK, "calibrator": "synthetic"}
    asking = ask(replace(toy, run=run), study="./mine.prefcal", **options)
    while not begun:
        time.sleep(0.01)
    threading.Timer(0.3, go.set).start()
    started = time.monotonic()
    asking.close()
    assert time.monotonic() - started < 4  # it does not wait in vain
    assert len(begun) == 1
    assert asking.wait() is False
    with ask(toy, study="./mine.prefcal", **options) as second:
        assert second.wait(30)
        assert len(second.to_frame()) == 4


def test_unknown_options_are_refused_by_name():
    with pytest.raises(SettingsError, match="ask has no option 'terminal': expected one of"):
        ask(toy_scenario(), terminal=True)


def test_nothing_is_reported_before_an_answer():
    with ask(toy_scenario(), study="./mine.prefcal", **QUICK) as asking, pytest.raises(StudyError):
        asking.report()


class Notebook(BaseHTTPRequestHandler):
    """A page that shows the output of a cell, as a notebook on this machine does."""

    html = ""

    def do_GET(self):
        body = f"<!DOCTYPE html><meta charset=utf-8>{self.html}".encode()
        self.send_response(200)
        self.send_header("content-type", "text/html; charset=utf-8")
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *words):
        """Print nothing."""


def test_a_notebook_on_this_machine_shows_the_question_in_a_frame_and_answers_there(browser):
    with (
        ask(toy_scenario(), study="./mine.prefcal", **QUICK) as asking,
        ThreadingHTTPServer(("127.0.0.1", 0), Notebook) as server,
    ):
        Notebook.html = asking._repr_html_()
        threading.Thread(target=server.serve_forever, daemon=True).start()
        page = browser.new_page()
        page.goto(f"http://127.0.0.1:{server.server_port}/")
        frame = page.frame_locator("iframe")
        frame.locator("#progress-text").get_by_text("question 1 of 3").wait_for(timeout=60_000)
        curves = frame.locator(".js-plotly-plot .scatterlayer path.js-line")
        curves.nth(1).wait_for(state="attached", timeout=60_000)
        page.wait_for_timeout(500)  # the page takes no verdict in the first moment of a question
        if "PREFCAL_SHOTS" in os.environ:
            page.screenshot(path=SHOTS / "notebook.png")
        frame.locator("#progress-text").click()  # a frame gets keys once it has the focus
        page.keyboard.press("ArrowLeft")
        frame.locator("#progress-text").get_by_text("question 2 of 3").wait_for(timeout=60_000)
        assert len(asking.to_frame(answers=True)) == 1
        server.shutdown()


def test_elsewhere_there_is_a_link_and_no_frame(browser):
    with ask(toy_scenario(), study="./mine.prefcal", **QUICK) as asking:
        page = browser.new_page()
        page.set_content(asking._repr_html_())
        assert page.locator("iframe").count() == 0
        assert page.locator("a").get_attribute("href") == asking.link


def test_a_certificate_is_there_where_the_agent_simulates():
    simulated = replace(toy_scenario(), simulated=True)
    with ask(simulated, agent="screening", n_max=5, simulate=80, calibrator="latent") as asking:
        asking.wait()
        found = asking.certificate
        assert found.probability == 0.95
        assert found.explained == (found.chance is not None)
    with ask(toy_scenario(), calibrator="latent", **QUICK) as asking:
        asking.wait()
        assert asking.certificate is None


def test_the_chance_of_the_next_run_is_there_where_every_run_is_shown():
    with ask(toy_scenario(), calibrator="latent", n_max=8, n_init=3) as asking:
        asking.wait()
        assert 0 < asking.chance_of_better < 1
    with ask(toy_scenario(), calibrator="latent", n_max=8, n_init=3, outcomes=False) as asking:
        asking.wait()
        assert asking.chance_of_better is None
