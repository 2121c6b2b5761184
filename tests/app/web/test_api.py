"""What the page sends is read strictly, or told as an error; the verification that it asks for."""

import json
import sqlite3
import threading
import time
from contextlib import suppress
from typing import Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import Struct

from prefcal_app import report
from prefcal_app.session.interview import Steps
from prefcal_app.web import api
from prefcal_app.web.api import (
    LONGEST_TEXT,
    MalformedError,
    Real,
    Text,
    Whole,
    bit,
    digits,
    read_json,
    read_query,
)
from prefcal_env.disk import digest_of
from prefcal_env.errors import PrefcalError, RecordError, ScenarioError, StaleError, StudyError
from prefcal_scenarios.verification.result import BEST, Verified, WorstRun
from support.windows import make_room


class Fields(Struct, forbid_unknown_fields=True):
    n: Whole
    theta: tuple[Real, ...]
    word: Literal["left", "right"]
    on: bool
    note: Text


GOOD = {"n": 3, "theta": (1.0, 2.5), "word": "left", "on": True, "note": "θ is fine\n"}


def test_an_agreed_body_is_read():
    assert read_json(json.dumps(GOOD).encode(), Fields) == GOOD


WRONG = {
    "n": (3.0, True, "3", None, -1, 2**53, [3]),
    "word": ("up", ["left"], None),
    "on": (1, "true"),
    "note": (3, "a\0b", "\ud800", "\x1b[31m", "x" * (LONGEST_TEXT + 1)),
    "theta": ([10**400], [True], ["1"], [None], [[1]]),
    "more": (1,),
}


@pytest.mark.parametrize("change", [{name: value} for name, values in WRONG.items() for value in values])
def test_another_value_or_field_is_refused(change):
    with pytest.raises(MalformedError, match=r"\.$"):
        read_json(json.dumps({**GOOD, **change}).encode(), Fields)


@pytest.mark.parametrize("name", GOOD)
def test_a_missing_field_is_refused_and_named(name):
    rest = {key: value for key, value in GOOD.items() if key != name}
    with pytest.raises(MalformedError, match=f"missing required field `{name}`"):
        read_json(json.dumps(rest).encode(), Fields)


SHORT = (
    b"",
    b"[]",
    b"3",
    b"null",
    b"{",
    b'{"n": 1',
    b'{"n": NaN}',
    b'{"n": -Infinity}',
    b"\xff",
    b"{}\0",
    b"{} {}",
)
LONG = (b"[" * 50_000, b'{"n":' * 9_000, b'{"n": ' + b"9" * 60_000 + b"}", b'{"theta": [1e999]}')


@pytest.mark.parametrize("body", [*SHORT, *LONG, '{"n": 1}'.encode("utf-16"), b"\xef\xbb\xbf{}"])
def test_what_is_no_json_object_is_refused(body):
    with pytest.raises(MalformedError):
        read_json(body, Fields)


@given(st.binary(max_size=60))
def test_any_query_is_read_or_refused(query):
    with suppress(MalformedError):
        assert read_query(query, {"after": digits, "blind": bit}).keys() <= {"after", "blind"}


def test_a_query_is_read():
    assert read_query(b"after=12&blind=1", {"after": digits, "blind": bit}) == {"after": 12, "blind": True}
    assert read_query(b"", {"after": digits}) == {}


QUERIES = (
    b"after= after=-1 after=1.0 after=1&after=1 after x=1 & after=+1 after=%D9%A3 after=%00 "
    b"blind=2 blind=true a=%ff"
)


@pytest.mark.parametrize("query", [*QUERIES.split(), b"after=" + b"9" * 40, b"&".join([b"after=1"] * 1000)])
def test_another_query_is_refused(query):
    with pytest.raises(MalformedError):
        read_query(query, {"after": digits, "blind": bit})


@pytest.mark.parametrize(
    ("error", "status", "kind"),
    [
        (StaleError("late"), 409, "stale"),
        (RecordError("column 3"), 422, "record"),
        (StudyError("the disk is full"), 507, "study"),
        (PrefcalError("no"), 422, "refused"),
    ],
)
def test_errors_are_told_in_a_sentence(room, monkeypatch, error, status, kind):
    def fail(self):
        raise error

    monkeypatch.setattr(Steps, "finish", fail)
    response = room.post("finish")
    told = response.json()
    assert (response.status_code, told["kind"], told["error"]) == (status, kind, str(error))
    assert (told["now"] is not None) == (status == 409)


def test_a_fault_of_ours_is_told_and_logged(room, monkeypatch, caplog):
    def fail(self):
        raise sqlite3.InterfaceError("a bug")

    monkeypatch.setattr(Steps, "finish", fail)
    response = room.post("finish")
    assert response.status_code == 500
    assert "a bug" in response.json()["error"]
    assert response.headers["cache-control"] == "no-store"
    assert "a bug" in caplog.text


@pytest.fixture
def folder(tmp_path):
    (tmp_path / BEST).write_text("{}")
    return tmp_path


def said_of(folder):
    return Verified(
        statement="2 of 2 runs keep the stated limits.",
        limits_kept="Stated limits: a safe end.",
        share=1.0,
        bound=0.7,
        runs=2,
        planned=2,
        baseline="current tuning",
        kpis=(("overshoot [%]", "≤ 5", "1", "0", "2", "7", "5", "9"),),
        margins=(("phase margin [°]", "60", "44"),),
        basis="margins of the law",
        effects=tuple(f"effect {k}" for k in range(9)),
        worst=(WorstRun("within the limits", {"dead time": 7.1234567}, 3, units={"dead time": "s"}),),
        varied=("dead time 4.8 to 7.2 s",),
        left_out=("sampling jitter is not varied",),
        scenario="lag",
        version="1",
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
        (best.parent / report.write.picture(0)).touch()
        return said

    monkeypatch.setattr(report.write, "verify_best", verify)
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
    assert said["effects"] == [f"effect {k}" for k in range(4)]
    assert [table["label"] for table in said["tables"]] == ["Stability margins", "KPIs of the varied plants"]
    assert all(
        len(row["cells"]) == len(table["columns"]) - 1 for table in said["tables"] for row in table["rows"]
    )
    (worst,) = said["worst"]
    assert (worst["values"], worst["picture"]) == ("dead time 7.12 s", "/report/worst_run_1.png")
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

    monkeypatch.setattr(report.write, "verify_best", verify)
    page.reports.folder = folder
    page.post("verify")
    page.post("stop_verifying")
    assert ended.wait(20)
    assert not until(page.page(), lambda told: not told["running"])["problem"]


def test_what_went_wrong_is_said_and_it_can_start_again(page, folder, monkeypatch):
    def refuse(best, *, progress):
        raise ScenarioError("give it parameters as arguments")

    monkeypatch.setattr(report.write, "verify_best", refuse)
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

    monkeypatch.setattr(report.write, "verify_best", verify)
    page.reports.folder = folder
    found = api.Verifying(page.reports)
    found.start()
    assert found.running
    found.close()
    assert not found.running
    assert Verified.read(folder) == said_of(folder)
    api.Verifying(page.reports).close()  # nothing runs
