"""A live plant in the terminal: the confirmation, and `k`, which stops a run."""

import time

import pytest

from prefcal_app.session import Background, Phase
from prefcal_app.session.study import Recovery
from prefcal_app.terminal.converse import ANSWER, _Conversation
from prefcal_env.worlds.live import LiveRig
from prefcal_scenarios.scenario import KPI, Scenario
from support.interviews import begin
from support.talking import console_of
from worlds.live.memory import Memory, memory_rig


@pytest.fixture
def plant():
    return Memory()


@pytest.fixture
def interview(plant, tmp_path, monkeypatch):
    real = LiveRig.drive

    def sleep(seconds):
        time.sleep(seconds / 50)
        plant.sleep(seconds)

    def drive(self, theta, confirm, **rest):
        return real(self, theta, confirm, clock=plant.clock, sleep=sleep, **rest)

    recover = LiveRig.recover

    def recovered(self, **rest):
        return recover(self, clock=plant.clock, sleep=sleep, **rest)

    monkeypatch.setattr(LiveRig, "drive", drive)
    monkeypatch.setattr(LiveRig, "recover", recovered)
    rig = memory_rig(plant, tmp_path, instructions="Open the drain.")
    kpi = KPI("overshoot of level", "overshoot", "m", better="lower")
    return begin(Scenario("tank", "A tank", rig.space, rig, kpis=(kpi,)), n_max=4)


def talk(interview, lines, *, stops=lambda: False, keys=lambda: "x"):
    """The conversation with these lines and answers; `k` is typed whenever `stops` says so."""
    console = console_of()
    written = iter(lines)

    def said(words):
        return keys() if words == ANSWER else next(written)

    talking = _Conversation(interview, console, said, typed=lambda: "k" if stops() else None)
    with Background(interview):
        talking.run()
    return console.export_text()


def test_nothing_is_written_unless_the_person_types_yes(interview, plant):
    out = talk(interview, ["y", "again", "", "stop"])
    assert plant.writes == []
    assert out.count("confirm what is written to the plant") == 4
    assert "T_i: 10 → " in out
    assert "limits 1 to 60, at most 5 per second" in out
    assert "Open the drain." in out


def test_a_confirmed_run_leads_to_the_next_one(interview, plant):
    talk(interview, ["yes", "stop"])
    assert len(interview.now().state.finished) == 1
    assert plant.values["kp"] == pytest.approx(1.0)


def test_k_stops_the_run_and_restores_the_old_values(interview, plant):
    out = talk(interview, ["yes"], stops=lambda: plant.values["sp"] > 1.9)
    assert interview.now().phase is Phase.FAILED
    assert "The old values are restored" in out
    assert [plant.values[node] for node in ("kp", "ti", "sp")] == pytest.approx([1.0, 10.0, 1.0])


def test_a_plant_without_its_old_values_is_named_beside_a_question_and_tried_again(interview, plant):
    def refuse_in_the_second_run(plant):
        if plant.values["sp"] == 2.0 and interview.now().state.finished:
            plant.refuses = "sp"

    def keys():
        until = time.monotonic() + 20.0
        while interview.now().plant.recovery is not Recovery.FAILED and plant.refuses:
            assert time.monotonic() < until
            time.sleep(0.01)
        if len(typed) == 2:
            plant.at, plant.refuses = lambda plant: None, ""
        return typed.pop(0)

    plant.at, typed = refuse_in_the_second_run, ["w", "again", "x"]
    out = talk(interview, ["yes", "yes"], keys=keys)
    assert interview.now().phase is Phase.QUESTION
    missing = "The plant does not have its old values yet: "
    assert "set-point: the server memory refuses" in out[out.index(missing) :]
    assert "g or again tries to restore them" in out
    assert "The old values are restored." in out
    assert plant.values["sp"] == pytest.approx(1.0)


def test_a_plant_without_its_old_values_is_named_where_a_run_has_failed(interview, plant):
    plant.at = lambda p: setattr(p, "refuses", "sp" if p.values["sp"] == 2.0 else "")
    typed = ["?", "again", "x"]

    def keys():
        until = time.monotonic() + 20.0
        while interview.now().plant.recovery is not Recovery.FAILED and plant.refuses:
            assert time.monotonic() < until
            time.sleep(0.01)
        if len(typed) == 2:
            plant.at, plant.refuses = lambda plant: None, ""
        return typed.pop(0)

    out = talk(interview, ["yes", "stop"], stops=lambda: plant.refuses == "sp", keys=keys)
    assert "The plant does not have its old values yet: " in out
    assert plant.values["sp"] == pytest.approx(1.0)
