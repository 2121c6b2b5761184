"""The verification of the result, as the page asks for it."""

import threading
import time
from dataclasses import replace

import pytest

from prefcal_app import report
from prefcal_app.web import api
from prefcal_env.disk import digest_of
from prefcal_env.errors import ScenarioError, StaleError
from prefcal_scenarios.verification.said import BEST, Verified, WorstRun
from support.verified import FOUND
from support.windows import make_room


@pytest.fixture
def folder(tmp_path):
    (tmp_path / BEST).write_text("{}")
    return tmp_path


def said_of(folder):
    return replace(
        FOUND,
        statement="2 of 2 runs keep the stated limits.",
        lines=("[kpis]", "overshoot = {}"),
        runs=2,
        planned=2,
        effects=tuple(f"effect {k}" for k in range(9)),
        worst=(WorstRun("holds", {"dead time": 7.1234567}, 3, units={"dead time": "s"}),),
        best=digest_of(folder / BEST),
    )


@pytest.fixture
def runs(monkeypatch):
    """Verifications of two runs, each of which waits for `go`."""
    go, counted = threading.Event(), []

    def verify(best, *, progress):
        counted.append(best)
        progress(1, 2)
        assert go.wait(20)
        progress(2, 2)
        said = said_of(best.parent)
        said.write(best.parent)
        (best.parent / report.verifying.picture(0)).touch()
        return said

    monkeypatch.setattr(report.verifying, "verify_best", verify)
    return go, counted


def until(page, ready):
    """What the page is told as soon as that is `ready`."""
    end = time.monotonic() + 20
    while not ready(told := page.get("/api/verification").json()):
        assert time.monotonic() < end
        time.sleep(0.01)
    return told


@pytest.fixture
def page(room):
    return make_room(room.interview)


def test_one_verification_runs_at_a_time_and_its_result_is_shown_and_judged(page, folder, runs):
    go, counted = runs
    page.reports.folder = folder
    nothing = page.page().get("/api/verification").json()
    assert (nothing["running"], nothing["said"]) == (False, None)
    assert page.post("verify").json()["running"]
    assert page.post("verify").json()["running"]
    told = until(page.page(), lambda told: told["done"] == 1)
    assert (told["planned"], told["said"], counted) == (2, None, [folder / BEST])
    go.set()
    said = until(page.page(), lambda told: not told["running"])["said"]
    assert said["statement"].startswith("2 of 2 runs")
    assert said["verdict"] == FOUND.headline
    assert said["lines"] == "[kpis]\novershoot = {}"
    assert said["effects"] == [f"effect {k}" for k in range(4)]
    assert [table["label"] for table in said["tables"]] == ["Stability margins", "KPIs of the varied plants"]
    assert all(
        len(row["cells"]) == len(table["columns"]) - 1 for table in said["tables"] for row in table["rows"]
    )
    (worst,) = said["worst"]
    assert (worst["values"], worst["picture"]) == ("dead time 7.123 s", "/report/worst_run_1.png")
    of = {"seed": worst["seed"], "best": said["best"]}
    judged = page.post("judge", run=0, **of, acceptable=False).json()["said"]["worst"]
    assert [each["verdict"] for each in judged] == ["not acceptable"]
    assert Verified.read(folder).worst[0].verdict == "not acceptable"
    for other in ({"seed": 4}, {"best": "0"}):  # it was verified again since the page looked
        stale = page.post("judge", run=0, **{**of, **other}, acceptable=True)
        assert stale.status_code == 409
        assert "verified again" in stale.json()["error"]
    assert Verified.read(folder).worst[0].verdict == "not acceptable"


def test_a_stop_ends_the_runs_early(page, folder, monkeypatch):
    ended = threading.Event()

    def verify(best, *, progress):
        try:
            while not ended.wait(0.01):
                progress(1, 2)
        except KeyboardInterrupt:
            ended.set()

    monkeypatch.setattr(report.verifying, "verify_best", verify)
    page.reports.folder = folder
    page.post("verify")
    page.post("stop_verifying")
    assert ended.wait(20)
    assert not until(page.page(), lambda told: not told["running"])["problem"]


def test_a_verification_of_another_file_is_said_not_to_count(page, folder):
    page.reports.folder = folder
    assert page.page().get("/api/verification").json()["problem"] == ""
    (folder / "verification.json").write_text("{")
    said = page.page().get("/api/verification").json()["problem"]
    assert said == "verification.json is damaged, or of another version of prefcal"


def test_what_went_wrong_is_said_and_it_can_start_again(page, folder, monkeypatch):
    def refuse(best, *, progress):
        raise ScenarioError("give it parameters as arguments")

    monkeypatch.setattr(report.verifying, "verify_best", refuse)
    page.reports.folder = folder
    page.post("verify")
    told = until(page.page(), lambda told: not told["running"])
    assert told["problem"] == "give it parameters as arguments"
    assert page.post("verify").json()["problem"] == "" or until(page.page(), lambda told: told["problem"])


def test_without_a_report_nothing_starts_and_nothing_is_judged(page):
    assert not page.post("verify").json()["running"]
    given = {"seed": 0, "best": "", "acceptable": True}
    assert page.post("judge", run=0, **given).status_code == 409
    assert page.post("judge", run=-1, **given).status_code == 400
    with pytest.raises(StaleError):
        api.Verifying(page.reports).judge(0, **given)


def test_closing_ends_the_runs_and_waits_until_they_are_kept(page, folder, monkeypatch):
    def verify(best, *, progress):
        try:
            while True:
                progress(1, 2)
                time.sleep(0.01)
        except KeyboardInterrupt:
            time.sleep(0.1)
            said_of(best.parent).write(best.parent)

    monkeypatch.setattr(report.verifying, "verify_best", verify)
    page.reports.folder = folder
    found = api.Verifying(page.reports)
    found.start()
    assert found.running
    found.close()
    assert not found.running
    assert Verified.read(folder) == said_of(folder)
    api.Verifying(page.reports).close()  # nothing runs
