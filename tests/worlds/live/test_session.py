"""An interview about a live plant, in Python and in the terminal: asked before each run, stopped by `k`."""

import time

import numpy as np
import pytest

from prefcal_app.session import Background, Choice, Phase, actions
from prefcal_app.session.study import Recovery
from prefcal_app.terminal.converse import ANSWER, _Conversation
from prefcal_env import End
from prefcal_env.errors import StaleError, StudyError
from prefcal_env.worlds.live import Journal, LiveRig
from prefcal_scenarios.scenario import KPI, Scenario
from support.interviews import begin, reopened
from support.talking import console_of
from worlds.live.memory import Memory, memory_rig, simulate_time


@pytest.fixture
def plant():
    return Memory()


@pytest.fixture
def scenario(plant, tmp_path, monkeypatch):
    simulate_time(plant, monkeypatch)
    rig = memory_rig(plant, tmp_path)
    kpi = KPI("overshoot of level", "overshoot", "m", better="lower")
    return Scenario("tank", "A tank", rig.space, rig, kpis=(kpi,))


def waited_for(interview):
    """Work until a person must do something: what is waited for."""
    while True:
        now = interview.now()
        known = now.plant.changes is not None or now.plant.problem
        if now.phase not in (Phase.RUNNING, Phase.CONFIRM) or (now.phase is Phase.CONFIRM and known):
            return now
        assert interview.work()


def test_each_run_is_confirmed_saved_and_compared(scenario, plant, tmp_path):
    path = tmp_path / "mine.prefcal"
    interview, confirmed, answered = begin(scenario, n_max=4, path=path), 0, 0
    while (now := waited_for(interview)).phase is not Phase.OVER:
        if now.phase is Phase.CONFIRM:
            before = len(plant.writes)
            assert [change.old for change in now.plant.changes] == pytest.approx([1.0, 10.0, 1.0])
            assert len(plant.writes) == before
            interview.do(actions.WriteAndStart(now.pending.index))
            confirmed += 1
        else:
            assert len(now.state.finished) == confirmed
            interview.do(actions.Answer(now.question.id, Choice.LEFT))
            answered += 1
    assert confirmed == 4
    interview.file.close()
    state = reopened(scenario, path).now().state
    assert len(state.answers) == answered
    assert len(state.finished) == 4
    assert plant.values["kp"] == pytest.approx(1.0)


def test_front_ends_are_told_when_the_values_to_confirm_are_known(scenario):
    interview = begin(scenario)
    while interview.now().phase is not Phase.CONFIRM:
        assert interview.work()
    while (asked := interview.now()).plant.changes is None:
        assert "write_and_start" not in asked.can
        assert interview.work()  # it restores what an earlier run left, and reads the plant
        assert interview.now().version > asked.version
    assert "write_and_start" in asked.can


def test_nothing_is_written_before_the_confirmation(scenario, plant):
    interview = begin(scenario)
    with pytest.raises(StaleError, match="not known yet"):
        interview.do(actions.WriteAndStart(0))
    waited_for(interview)
    with pytest.raises(StaleError, match="nothing was written"):
        interview.do(actions.WriteAndStart(1))
    assert not interview.work()
    assert plant.writes == []


def test_a_plant_that_changed_since_the_confirmation_is_not_touched(scenario, plant):
    interview = begin(scenario)
    waited_for(interview)
    interview.do(actions.WriteAndStart(0))
    plant.values["kp"] = 1.2
    now = waited_for(interview)
    assert now.phase is Phase.FAILED
    assert plant.writes == []
    interview.do(actions.Retry())
    assert waited_for(interview).plant.changes[0].old == pytest.approx(1.2)


def test_a_stopped_run_can_be_tried_again_or_counted_as_failed(scenario, plant):
    interview = begin(scenario)
    waited_for(interview)
    plant.at = lambda p: interview.do(actions.StopRun(0)) if 11.9 < p.now < 12.3 else None
    interview.do(actions.WriteAndStart(0))
    with pytest.raises(StaleError, match="stop it first"):
        interview.do(actions.Finish())
    now = waited_for(interview)
    assert now.phase is Phase.FAILED
    assert "The old values are restored" in now.problem
    assert plant.values["kp"] == pytest.approx(1.0)
    interview.do(actions.Fail(0, now.problem))
    assert interview.past.experiment(0).end is End.FAILED
    assert len(interview.past.experiment(0).t)


def test_on_a_full_disk_the_record_of_a_stopped_run_is_kept_for_the_next_try(scenario, plant, monkeypatch):
    interview = begin(scenario)
    waited_for(interview)
    plant.at = lambda p: interview.do(actions.StopRun(0)) if 11.9 < p.now < 12.3 else None
    interview.do(actions.WriteAndStart(0))
    waited_for(interview)

    def full(*events):
        raise StudyError("the disk is full")

    with monkeypatch.context() as changed:
        changed.setattr(interview.file, "append", full)
        with pytest.raises(StudyError, match="the disk is full"):
            interview.do(actions.Fail(0))
    interview.do(actions.Fail(0))
    assert len(interview.past.experiment(0).t)


def test_a_kept_theta_does_not_hide_that_the_set_point_is_not_taken_back(scenario, plant, tmp_path):
    rig = memory_rig(plant, tmp_path, after="keep")
    interview = begin(Scenario("tank", "A tank", rig.space, rig, kpis=scenario.kpis))
    waited_for(interview)
    plant.at = lambda p: setattr(p, "refuses", "sp" if plant.values["sp"] == 2.0 else "")
    interview.do(actions.WriteAndStart(0))
    assert interview.work()
    assert "set-point: the server memory refuses" in interview.now().plant.problem
    plant.at, plant.refuses = lambda p: None, ""
    assert interview.work()
    assert plant.values["sp"] == pytest.approx(1.0)


def test_an_unreachable_plant_is_a_problem_that_can_be_looked_at_again(scenario, plant):
    plant.up = False
    interview = begin(scenario)
    now = waited_for(interview)
    assert "no connection to memory" in now.plant.problem
    plant.up = True
    interview.do(actions.Retry())
    assert waited_for(interview).plant.changes


def test_a_failed_recovery_stays_visible_and_nothing_is_written_until_it_succeeds(scenario, plant, tmp_path):
    Journal(tmp_path / "old.json").save({"K_p": 1.5, "T_i": 10.0, "set-point": 1.0})
    plant.refuses = "kp"
    interview = begin(scenario)
    now = waited_for(interview)
    for _ in range(3):
        assert now.phase is Phase.CONFIRM
        assert now.plant.recovery is Recovery.FAILED
        assert "K_p: the server memory refuses" in now.plant.problem
        assert now.plant.changes is None
        with pytest.raises(StaleError, match="does not have its old values yet"):
            interview.do(actions.WriteAndStart(now.pending.index))
        assert not interview.work()
        interview.do(actions.Retry())
        now = waited_for(interview)
    assert "kp" not in {node for _, node, _ in plant.writes}
    plant.refuses = ""
    interview.do(actions.Retry())
    now = waited_for(interview)
    assert now.plant.problem == ""
    assert now.plant.recovery is Recovery.DONE
    assert now.plant.changes[0].old == pytest.approx(1.5)
    interview.do(actions.WriteAndStart(now.pending.index))
    assert interview.work()
    assert len(interview.now().state.finished) == 1


def test_a_recovery_in_progress_is_not_called_failed(scenario, plant, tmp_path):
    Journal(tmp_path / "old.json").save({"K_p": 5.0, "T_i": 10.0, "set-point": 1.0})
    interview, seen = begin(scenario), set()
    plant.at = lambda p: seen.add(interview.now().plant.recovery)
    waited_for(interview)
    assert seen == {Recovery.RUNNING}
    assert plant.values["kp"] == pytest.approx(5.0)


def test_a_recovery_that_fails_while_a_question_is_open_can_be_tried_again(scenario, plant, tmp_path):
    rig = memory_rig(plant, tmp_path, after="keep")
    interview = begin(Scenario("tank", "A tank", rig.space, rig, kpis=scenario.kpis))
    for _ in range(2):
        now = waited_for(interview)
        plant.at = lambda p: setattr(p, "refuses", "sp" if p.values["sp"] == 2.0 else "")
        plant.at = plant.at if now.pending.index else lambda p: None
        interview.do(actions.WriteAndStart(now.pending.index))
        assert interview.work()
    while interview.work():
        pass
    now = interview.now()
    assert now.phase is Phase.QUESTION
    assert now.plant.recovery is Recovery.FAILED
    assert "set-point" in now.plant.problem
    plant.at, plant.refuses = lambda p: None, ""
    interview.do(actions.Retry())
    assert interview.work()
    assert interview.now().plant.recovery is Recovery.DONE
    assert plant.values["sp"] == pytest.approx(1.0)
    assert interview.now().phase is Phase.QUESTION


def test_a_run_that_raised_has_its_old_values_restored_before_anything_else(scenario, plant, monkeypatch):
    real = LiveRig.drive

    def broken(self, *args, **rest):
        real(self, *args, **rest)
        plant.values["kp"] = 5.0
        self.journal.save({"K_p": 1.0, "T_i": 10.0, "set-point": 1.0})
        raise OSError("no space left on the device")

    interview = begin(scenario)
    now = waited_for(interview)
    assert now.plant.recovery is Recovery.DONE
    monkeypatch.setattr(LiveRig, "drive", broken)
    interview.do(actions.WriteAndStart(now.pending.index))
    assert interview.work()
    assert interview.now().phase is Phase.FAILED
    assert interview.now().plant.recovery is Recovery.DUE
    assert interview.work()
    assert interview.now().plant.recovery is Recovery.DONE
    assert plant.values["kp"] == pytest.approx(1.0)


def test_an_experiment_that_could_not_be_saved_is_saved_later_without_another_run(
    scenario, plant, monkeypatch
):
    interview = begin(scenario)
    waited_for(interview)

    def full(*events):
        raise StudyError("the disk is full")

    interview.do(actions.WriteAndStart(0))
    with monkeypatch.context() as changed:
        changed.setattr(interview.file, "append", full)
        assert interview.work()
    assert interview.now().phase is Phase.FAILED
    assert not interview.now().state.finished
    before = len(plant.writes)
    interview.do(actions.Retry())
    while not interview.now().state.finished:
        assert interview.work()
    assert len(plant.writes) == before
    assert len(interview.past.experiment(0).t)


class KilledError(BaseException):
    """The process ends at once; nothing after it runs."""


def test_no_answer_and_no_experiment_is_lost_by_kills_at_random_instants(scenario, plant, tmp_path):
    rng, path = np.random.default_rng(7), tmp_path / "mine.prefcal"
    interview = begin(scenario, n_max=5, path=path)
    answered, ran, kills = 0, 0, 0
    while (now := waited_for(interview)).phase is not Phase.OVER:
        if now.phase is Phase.QUESTION:
            answered += 1
            interview.do(actions.Answer(now.question.id, Choice.LEFT))
            continue
        until = plant.now + rng.uniform(0.0, 90.0)

        def kill(plant, until=until):
            if until <= plant.now:
                raise KilledError

        plant.at = kill
        interview.do(actions.WriteAndStart(now.pending.index))
        try:
            interview.work()
            ran += 1
        except KilledError:
            kills += 1
            interview.file.close()
            interview = reopened(scenario, path)
        plant.at = lambda plant: None
        state = interview.now().state
        assert (len(state.answers), len(state.finished)) == (answered, ran)
    assert kills
    assert ran == 5
    assert [plant.values[node] for node in ("kp", "ti", "sp")] == pytest.approx([1.0, 10.0, 1.0])


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
