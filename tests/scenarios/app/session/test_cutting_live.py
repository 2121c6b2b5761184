"""A run on a live plant is cut short: offered first, done alone only if asked to."""

import threading

import numpy as np
import pytest

from prefcal_env import End
from prefcal_env.errors import StaleError
from prefcal_env.preferences.answer import Preference
from prefcal_scenarios.app.session import Choice, Phase
from prefcal_scenarios.app.session.live.state import Live
from prefcal_scenarios.app.session.live.watching import watched
from prefcal_scenarios.app.terminal.converse import _live_words
from prefcal_scenarios.app.web.view import now_view
from prefcal_scenarios.app.web.view.preview import _running
from prefcal_scenarios.kpis import bounds_of
from prefcal_scenarios.scenario import KPI, Scenario
from support.interviews import begin, reopened
from support.live import Memory, memory_rig, simulate_time


@pytest.fixture
def plant():
    return Memory()


@pytest.fixture
def scenario(plant, tmp_path, monkeypatch):
    simulate_time(plant, monkeypatch)
    rig = memory_rig(plant, tmp_path)
    kpi = KPI("integrated error of level", "error", "m s", better="lower")
    return Scenario("tank", "A tank", rig.space, rig, kpis=(kpi,))


def waited_for(interview):
    while (now := interview.now()).phase in (Phase.RUNNING, Phase.CONFIRM):
        if now.phase is Phase.CONFIRM and (now.live.changes or now.live.problem):
            return now
        assert interview.work()
    return now


def two_compared(scenario, **more):
    """An interview that waits for the confirmation of its third run."""
    interview = begin(scenario, **more)
    for index in range(2):
        waited_for(interview)
        interview.write_and_start(index)
    interview.answer(waited_for(interview).question.id, Choice.LEFT)
    assert waited_for(interview).pending.index == 2
    return interview


def recording(interview):
    progress = interview.now().live.progress
    return progress is not None and progress.elapsed >= 3.0


def test_a_person_cuts_a_run_short_that_cannot_win(scenario, plant, tmp_path):
    path = tmp_path / "mine.prefcal"
    interview, seen = two_compared(scenario, path=path), []

    def at(_plant):
        if recording(interview) and not seen:
            with pytest.raises(StaleError, match="cannot be cut short now"):
                interview.cut_run(2)
            interview._flow.live.hopeless.set()
            seen.append((now_view(interview)["live"]["running"], interview.now().live))
            interview.cut_run(2)
            seen.append(now_view(interview)["live"]["running"])

    plant.at = at
    interview.write_and_start(2)
    now = waited_for(interview)
    (offered, live), cutting = seen
    assert offered["hopeless"]
    assert not offered["stopping"]
    assert "c and Enter cuts it short" in _live_words(live)
    assert cutting["cutting"]
    assert cutting["stopping"]
    assert now.phase is Phase.CONFIRM
    assert now.pending.index == 3
    made, closed = interview.experiment(2), now.state.history.comparisons[2]
    assert made.end is End.CUT_SHORT
    assert 3.0 <= made.duration < 10.0
    assert made.kpis == {}
    assert closed.question is None
    assert closed.answer.preference is Preference.INCUMBENT
    error = bounds_of(scenario, made)["integrated error of level"]
    assert closed.answer.outcomes[0]["integrated error of level"] == error > 0
    assert plant.values["kp"] == pytest.approx(1.0)
    assert plant.values["sp"] == pytest.approx(1.0)
    interview.study.close()
    assert reopened(scenario, path).now().state.history.cut_short() == {2}


class Hopeless:
    """Chances of a run that cannot win once it has recorded for 3 s."""

    def __init__(self):
        self.asked = []

    def is_hopeless(self, record):
        self.asked.append(record.duration)
        return record.duration >= 3.0


@pytest.mark.parametrize("cuts", [False, True])
def test_a_run_is_watched_while_it_records_and_cut_alone_only_if_asked_to(tmp_path, cuts):
    rig = memory_rig(Memory(), tmp_path, period=0.01, duration=0.25)
    told, chances = threading.Event(), Hopeless()
    live = Live(changed=told.set)
    rows = [(float(k), {"output level": 1.0, "input valve": 4.0, "reference level": 2.0})
            for k in range(5)]  # fmt: skip
    with watched(live, rig, np.array([1.0, 10.0]), chances, cuts=cuts):
        live._curve.append(rows[0])
        assert not told.wait(0.1)  # a single sample has no KPIs
        assert chances.asked == []
        live._curve.extend(rows[1:])
        assert told.wait(5.0)
    assert live.hopeless.is_set()
    assert live.cut.is_set() == cuts
    assert chances.asked[-1] == 4.0


def test_nothing_is_watched_if_nothing_can_be_said(tmp_path):
    before = threading.active_count()
    rig = memory_rig(Memory(), tmp_path)
    with watched(Live(), rig, np.array([1.0, 10.0]), None, cuts=True):
        assert threading.active_count() == before


def row(level):
    return {"output level": level, "input valve": 4.0, "reference level": 2.0}


class Failing(Hopeless):
    """Chances that cannot be told until the run has recorded for 3 s."""

    def __init__(self, error):
        super().__init__()
        self.error = error

    def is_hopeless(self, record):
        if not super().is_hopeless(record):
            raise self.error
        return True


@pytest.mark.parametrize("error", [ValueError("no band"), SystemExit("no band")])
def test_a_chance_that_cannot_be_told_is_said_and_worked_out_again(tmp_path, error):
    rig = memory_rig(Memory(), tmp_path, period=0.01, duration=0.25)
    told = threading.Event()
    live = Live(changed=told.set)
    live.begin()
    with watched(live, rig, np.array([1.0, 10.0]), Failing(error), cuts=True):
        live._curve.extend((float(k), row(1.0)) for k in range(3))
        assert told.wait(5.0)
        assert live.unwatched == f"{type(error).__name__}: no band"
        words = _live_words(live.now())
        assert "cannot tell whether this run can still win: " + live.unwatched in words
        assert _running(rig, live.now())["unwatched"] == live.unwatched
        assert not live.cut.is_set()
        told.clear()
        live._curve.extend((float(k), row(1.0)) for k in range(3, 5))
        assert told.wait(5.0)
        assert live.cut.wait(5.0)
    assert live.unwatched == ""


def test_a_record_with_a_single_good_sample_is_not_watched_yet(tmp_path):
    rig, chances = memory_rig(Memory(), tmp_path, period=0.01, duration=0.25), Hopeless()
    live = Live()
    with watched(live, rig, np.array([1.0, 10.0]), chances, cuts=True):
        live._curve.append((0.0, row(1.0)))
        live._curve.extend((float(k), row(np.nan)) for k in range(1, 9))
        assert not live.hopeless.wait(0.2)
    assert chances.asked == []
    assert live.unwatched == ""
