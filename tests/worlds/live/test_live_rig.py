"""A live rig writes within limits and rates, and puts back what it found, whatever happens."""

from dataclasses import replace

import numpy as np
import pytest

from contracts.sources import source_contract
from prefcal_env import End, Knob
from prefcal_env.errors import KnobError, LiveError, ScenarioError, SettingsError
from prefcal_env.sources import Stage
from prefcal_env.tables.recorded import bridge
from prefcal_env.worlds.live import Journal, LiveKnob, LiveStart, Tag
from worlds.live.memory import Memory, memory_rig, simulate_time
from worlds.live.sessions import simulated_sessions

THETA = np.array([4.0, 20.0])
OLD = {"kp": 1.0, "ti": 10.0, "sp": 1.0}


def drive(rig, plant, confirm=lambda changes: True, **more):
    return rig.drive(THETA, confirm, clock=plant.clock, sleep=plant.sleep, **more)


def written(plant):
    return {node: pytest.approx(plant.values[node]) for node in OLD}


def test_a_run_ramps_records_and_puts_the_old_values_back(tmp_path):
    plant, seen = Memory(), []
    rig = memory_rig(plant, tmp_path)
    driven = drive(rig, plant, lambda changes: seen.append(changes) or True)
    assert [(c.name, c.old, c.new) for c in seen[0]] == [
        ("K_p", 1.0, 4.0),
        ("T_i", 10.0, 20.0),
        ("set-point", 1.0, 2.0),
    ]
    experiment = driven.experiment
    assert experiment.end is End.TIME_UP
    assert driven.restored
    assert experiment.t == pytest.approx(np.arange(11))
    assert experiment.y[-1, 0] > 1.9
    assert [value for _, node, value in plant.writes if node == "kp"] == pytest.approx([2, 3, 4, 3, 2, 1])
    assert written(plant) == OLD
    assert rig.left is None
    assert "overshoot of level" in experiment.kpis


def test_nothing_is_written_without_a_confirmation(tmp_path):
    plant = Memory()
    driven = drive(memory_rig(plant, tmp_path), plant, lambda changes: False)
    assert plant.writes == []
    assert driven.stopped
    assert "not confirmed" in driven.why
    assert not (tmp_path / "old.json").exists()


def test_a_theta_outside_the_limits_is_refused_before_anything_is_written(tmp_path):
    plant = Memory()
    rig = memory_rig(plant, tmp_path)
    with pytest.raises(KnobError, match="K_p"):
        rig.drive(np.array([30.0, 20.0]), lambda changes: True)
    assert plant.writes == []


def test_a_plant_outside_the_limits_is_not_touched(tmp_path):
    plant = Memory()
    plant.values["ti"] = 90.0
    driven = drive(memory_rig(plant, tmp_path), plant)
    assert "the plant has 90 for T_i, expected one in [1, 60] s" in driven.why
    assert plant.writes == []


def test_the_old_values_are_on_the_disk_before_the_first_write(tmp_path):
    plant = Memory()
    rig = memory_rig(plant, tmp_path)
    write, seen = plant.write, []
    plant.write = lambda node, value: (seen.append(rig.left), write(node, value))
    drive(rig, plant)
    assert seen
    assert all(left == {"K_p": 1.0, "T_i": 10.0, "set-point": 1.0} for left in seen)


def test_an_abort_limit_ends_the_run_as_unsafe_and_puts_the_old_values_back(tmp_path):
    plant = Memory(at=lambda p: p.values.update(level=5.0) if p.now > 6 else None)
    driven = drive(memory_rig(plant, tmp_path), plant)
    assert driven.experiment.end is End.UNSAFE
    assert "level = 5 m is outside its abort limits [0, 3]" in driven.why
    assert written(plant) == OLD


def test_a_stop_ends_the_run_within_a_fifth_of_a_second(tmp_path):
    plant = Memory()
    driven = drive(memory_rig(plant, tmp_path, period=5.0, duration=60.0), plant, stop=lambda: plant.now > 30)
    assert driven.stopped
    assert driven.experiment.end is End.FAILED
    assert written(plant) == OLD
    first = min(t for t, node, _ in plant.writes if node == "kp" and t > 30)
    assert first <= 30.5


def test_a_lost_connection_is_waited_for_and_the_old_values_come_back_within_two_samples(tmp_path):
    plant, stages = Memory(), []

    def fail(p):
        p.up = not 5 < p.now < 300

    plant.at = fail
    knobs = (LiveKnob(memory_rig(plant, tmp_path).knobs[0].knob, "kp", 10.0),)
    rig = memory_rig(plant, tmp_path, knobs=knobs)
    driven = rig.drive(
        np.array([4.0]),
        lambda changes: True,
        clock=plant.clock,
        sleep=plant.sleep,
        tell=lambda progress: stages.append(progress.stage),
    )
    assert Stage.LOST in stages
    assert "no connection" in driven.why
    assert driven.restored
    assert plant.writes[-1][0] <= 302
    assert written(plant) == OLD


def test_a_server_that_refuses_sessions_for_minutes_is_waited_for(tmp_path):
    plant = Memory()
    connect = plant.connect

    def refuse():
        if 5 < plant.now < 300:
            raise LiveError("the server memory refuses: too many sessions")
        connect()

    plant.connect = refuse
    plant.at = lambda p: setattr(p, "up", not 5 < p.now < 7)
    assert drive(memory_rig(plant, tmp_path), plant).restored
    assert plant.now > 300
    assert written(plant) == OLD


def test_a_process_told_to_end_leaves_a_lost_plant_to_the_next_start(tmp_path):
    plant = Memory()

    def fail(p):
        p.up = p.now < 5

    plant.at = fail
    rig = memory_rig(plant, tmp_path)
    driven = drive(rig, plant, closing=lambda: plant.now > 20)
    assert not driven.restored
    assert rig.left == {"K_p": 1.0, "T_i": 10.0, "set-point": 1.0}
    plant.at, plant.up = lambda p: None, True
    assert rig.recover(clock=plant.clock, sleep=plant.sleep)
    assert written(plant) == OLD
    assert rig.left is None
    assert not rig.recover(clock=plant.clock, sleep=plant.sleep)


def test_what_a_killed_run_left_is_restored_before_the_next_run(tmp_path):
    plant = Memory()
    Journal(tmp_path / "old.json").save({"K_p": 1.5, "T_i": 10.0, "set-point": 1.0})
    seen = []
    drive(memory_rig(plant, tmp_path), plant, lambda changes: seen.append(changes) or True)
    assert seen[0][0].old == pytest.approx(1.5)
    assert plant.values["kp"] == pytest.approx(1.5)


def test_old_values_that_this_rig_does_not_write_must_be_restored_by_hand(tmp_path):
    plant = Memory()
    Journal(tmp_path / "old.json").save({"K_d": 1.5})
    with pytest.raises(LiveError, match=r"K_d = 1\.5, which this rig does not write"):
        drive(memory_rig(plant, tmp_path), plant)
    (tmp_path / "old.json").write_text("{")
    with pytest.raises(LiveError, match="restore them by hand"):
        drive(memory_rig(plant, tmp_path), plant)


def test_theta_can_be_kept_but_start_values_are_always_taken_back(tmp_path):
    plant = Memory()
    rig = memory_rig(plant, tmp_path, after="keep")
    driven = drive(rig, plant)
    assert not driven.restored
    assert driven.kept
    assert driven.problem == ""
    assert written(plant) == {"kp": 4.0, "ti": 20.0, "sp": 1.0}
    assert rig.left is None


def test_a_start_value_that_cannot_be_taken_back_is_told_apart_from_a_kept_theta(tmp_path):
    plant = Memory()
    plant.at = lambda p: setattr(p, "refuses", "sp" if p.now > 12 else "")
    rig = memory_rig(plant, tmp_path, after="keep")
    driven = drive(rig, plant)
    assert driven.why == ""
    assert (driven.restored, driven.kept) == (False, False)
    assert "set-point: the server memory refuses" in driven.problem


def test_a_kept_theta_stays_when_the_next_start_takes_back_the_set_point(tmp_path):
    plant = Memory()
    plant.at = lambda p: setattr(p, "refuses", "sp" if p.now > 12 else "")
    rig = memory_rig(plant, tmp_path, after="keep")
    drive(rig, plant)
    assert rig.left == {"set-point": 1.0}
    plant.at, plant.refuses = lambda p: None, ""
    assert rig.recover(clock=plant.clock, sleep=plant.sleep)
    assert written(plant) == {"kp": 4.0, "ti": 20.0, "sp": 1.0}
    assert rig.left is None


def test_a_kept_theta_without_start_values_needs_no_connection_at_the_end(tmp_path):
    plant = Memory()
    rig = memory_rig(plant, tmp_path, after="keep", start=())
    last = []
    plant.at = lambda p: setattr(p, "up", not last)
    driven = drive(rig, plant, tell=lambda now: last.append(1) if now.elapsed >= 10 else None)
    assert driven.kept
    assert rig.left is None


def test_an_aborted_run_takes_back_a_theta_that_would_have_been_kept(tmp_path):
    plant = Memory(at=lambda p: p.values.update(level=5.0) if p.now > 6 else None)
    driven = drive(memory_rig(plant, tmp_path, after="keep"), plant)
    assert driven.experiment.end is End.UNSAFE
    assert written(plant) == OLD


def test_a_refused_or_limited_value_ends_the_run(tmp_path):
    plant = Memory(refuses="ti")
    driven = drive(memory_rig(plant, tmp_path), plant)
    assert "refuses" in driven.why
    assert plant.values["kp"] == pytest.approx(1.0)
    limited = Memory()
    limited.at = lambda p: p.values.update(kp=min(p.values["kp"], 2.0))
    driven = drive(memory_rig(limited, tmp_path), limited)
    assert "the plant shows K_p = 2 instead of 4" in driven.why
    assert written(limited) == OLD


def test_a_value_that_is_refused_does_not_keep_the_others_from_being_restored(tmp_path):
    plant = Memory()
    plant.at = lambda p: setattr(p, "refuses", "kp" if p.now > 12 else "")
    rig = memory_rig(plant, tmp_path)
    driven = drive(rig, plant)
    assert not driven.restored
    assert written(plant) == OLD | {"kp": 4.0}
    assert rig.left
    with pytest.raises(LiveError, match="K_p: the server memory refuses"):
        rig.recover(clock=plant.clock, sleep=plant.sleep)


@pytest.mark.parametrize(
    ("at", "words"),
    [
        (lambda p: p.bad.add("kp"), "K_p = no good value instead of 1"),
        (lambda p: p.values.update(kp=7.0), "K_p = 7 instead of 1"),
    ],
)
def test_a_value_that_never_comes_back_is_left_to_a_person(tmp_path, at, words):
    plant = Memory()

    def fail(p):
        assert p.now < 1000
        if p.now > 12:
            at(p)

    plant.at = fail
    rig = memory_rig(plant, tmp_path)
    driven = drive(rig, plant)
    assert not driven.restored
    assert [plant.values[node] for node in ("ti", "sp")] == pytest.approx([10.0, 1.0])
    with pytest.raises(LiveError, match=words):
        rig.recover(clock=plant.clock, sleep=plant.sleep)
    assert rig.left


def test_a_process_told_to_end_restores_slowly_but_waits_for_a_blocked_value_only_briefly(tmp_path):
    plant = Memory()
    knobs = (LiveKnob(memory_rig(plant, tmp_path).knobs[0].knob, "kp", 0.1),)
    rig = memory_rig(plant, tmp_path, knobs=knobs)
    ends = {"clock": plant.clock, "sleep": plant.sleep, "closing": lambda: plant.now > 32}
    assert rig.drive(np.array([4.0]), lambda changes: True, **ends).restored
    assert plant.now > 60
    plant = Memory(at=lambda p: p.bad.add("kp") if p.now > 100 else None)
    rig = memory_rig(plant, tmp_path, period=50.0, duration=500.0)
    assert not drive(rig, plant, closing=lambda: plant.now > 200).restored
    assert plant.now < 220


def test_a_start_value_that_is_never_reached_is_no_completed_run(tmp_path):
    plant = Memory()
    plant.at = lambda p: p.values.update(sp=min(p.values["sp"], 1.5))
    driven = drive(memory_rig(plant, tmp_path, duration=5.0), plant)
    assert driven.experiment.end is End.FAILED
    assert "the plant shows set-point = 1.5 instead of 2" in driven.why
    assert written(plant) == OLD


def test_a_start_value_that_takes_longer_than_the_run_is_refused_before_it(tmp_path):
    plant = Memory()
    slow = LiveStart(Knob("set-point", 0.5, 2.5, "m"), "sp", 0.1, value=2.0)
    driven = drive(memory_rig(plant, tmp_path, start=(slow,)), plant)
    assert "set-point takes 10 s from 1 to 2 m" in driven.why
    assert plant.writes == []


def test_a_change_by_somebody_else_ends_the_run(tmp_path):
    plant = Memory()
    plant.at = lambda p: p.values.update(kp=7.0) if abs(p.now - 8) < 0.05 else None
    driven = drive(memory_rig(plant, tmp_path), plant)
    assert "K_p was changed on the plant to 7" in driven.why
    assert written(plant) == OLD


def test_bad_quality_is_data_but_not_for_long_where_a_limit_is_watched(tmp_path):
    plant = Memory()
    plant.at = lambda p: (p.bad.add if 6 < p.now < 8.5 else p.bad.discard)("level")
    experiment = drive(memory_rig(plant, tmp_path), plant).experiment
    assert experiment.end is End.TIME_UP
    assert np.isnan(experiment.signals["level as read"]).sum() == 2
    assert np.isfinite(experiment.y).all()
    plant = Memory()
    plant.at = lambda p: p.bad.add("level") if p.now > 6 else None
    assert "had no good value for 5 s" in drive(memory_rig(plant, tmp_path), plant).why


def test_conditions_start_and_end_a_run(tmp_path):
    plant = Memory()
    plant.values["level"] = 2.5
    rig = memory_rig(
        plant, tmp_path, ready={"level": (0.9, 1.1)}, done={"level": (1.9, 2.1)}, hold=2.0, duration=60.0
    )
    driven = drive(rig, plant)
    assert driven.experiment.end is End.SETTLED
    assert abs(driven.experiment.y[0, 0] - 1) < 0.1
    assert driven.experiment.duration < 30
    plant = Memory()
    rig = memory_rig(plant, tmp_path, ready={"level": (2.9, 3.1)}, ready_within=20.0)
    assert "was not met within 20 s: level in [2.9, 3.1] m" in drive(rig, plant).why


def test_two_processes_never_drive_one_plant(tmp_path):
    plant = Memory()
    rig = memory_rig(plant, tmp_path)
    with rig.journal.alone(), pytest.raises(LiveError, match="another prefcal"):
        drive(rig, plant)
    assert plant.writes == []


def test_a_live_rig_refuses_to_run_unattended(tmp_path):
    with pytest.raises(ScenarioError, match="a person confirms each run"):
        memory_rig(Memory(), tmp_path)(THETA)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"knobs": ()}, "needs a knob"),
        ({"duration": 0.5}, "duration must be above 1 s"),
        ({"period": float("nan")}, "period"),
        ({"after": "leave"}, "after must be restore or keep"),
        ({"ready": {"temperature": (0, 1)}}, "temperature"),
        ({"tags": (Tag("a", "a"), Tag("a", "b", "input"))}, "'a' twice"),
        ({"tags": (Tag("a", "a"), Tag("b", "b", "reference"))}, "name of an output"),
    ],
)
def test_an_impossible_rig_is_refused(tmp_path, changes, words):
    with pytest.raises(SettingsError, match=words):
        memory_rig(Memory(), tmp_path, **changes)


def test_tags_and_start_values_can_be_changed_like_all_data(tmp_path):
    rig = memory_rig(Memory(), tmp_path)
    level = replace(rig.tags[0], abort=(0.0, 2.0))
    assert (level.name, level.unit, level.role, level.abort) == ("level", "m", "output", (0.0, 2.0))
    assert replace(rig.start[0], rate=5.0).value == 2.0
    with pytest.raises(SettingsError, match="abort of 'level' must be low < high"):
        replace(level, abort=(2.0, 0.0))


def test_gaps_are_interpolated_in_outputs_and_held_in_inputs():
    values = np.array([np.nan, 1.0, np.nan, 3.0, np.nan])
    t = np.arange(5.0)
    assert bridge(t, values, held=False).tolist() == [1, 1, 2, 3, 3]
    assert bridge(t, values, held=True).tolist() == [1, 1, 1, 3, 3]


def test_a_value_that_was_never_good_is_not_made_up(tmp_path):
    plant = Memory(bad={"valve"})
    driven = drive(memory_rig(plant, tmp_path), plant)
    assert driven.experiment.end is End.FAILED
    assert "no good value of input valve" in driven.why
    assert not len(driven.experiment.t)
    plant = Memory(bad={"aim"})
    plant.values["aim"] = 2.0
    tags = (Tag("level", "level", unit="m"), Tag("level", "aim", "reference"))
    experiment = drive(memory_rig(plant, tmp_path, tags=tags), plant).experiment
    assert experiment.end is End.TIME_UP
    assert np.isnan(experiment.y_ref).all()
    assert np.isfinite(experiment.y).all()


def test_a_reference_is_read_in_the_unit_of_its_output(tmp_path):
    plant = Memory()
    plant.values["aim"] = 150.0
    tags = (Tag("level", "level", unit="m"), Tag("level", "aim", "reference", unit="cm"))
    experiment = drive(memory_rig(plant, tmp_path, tags=tags), plant).experiment
    np.testing.assert_allclose(experiment.y_ref, 1.5)
    start = LiveStart(Knob("set-point", 50.0, 250.0, "cm"), "sp", 1000.0, value=200.0)
    in_cm = memory_rig(Memory(), tmp_path, start=(start,))  # the reference is the node that is written
    assert in_cm.as_output(in_cm.tags[2], 200.0) == 2.0
    wrong = (Tag("level", "level", unit="m"), Tag("level", "aim", "reference", unit="bar"))
    with pytest.raises(SettingsError, match="reference of 'level' is in bar, which cannot be converted to m"):
        memory_rig(plant, tmp_path, tags=wrong)


def test_a_node_has_one_unit(tmp_path):
    written = memory_rig(Memory(), tmp_path).knobs[0]
    tags = [Tag("level", "level", unit="m"), Tag("gain", written.node, "input", unit="kg")]
    with pytest.raises(SettingsError, match="is read as 'gain' in kg: give both the unit"):
        memory_rig(
            Memory(), tmp_path, knobs=(replace(written, knob=replace(written.knob, unit="m")),), tags=tags
        )


def test_random_sessions_keep_every_promise():
    outcomes = simulated_sessions.run(300)
    assert sum(outcomes.values()) == 300
    assert {"killed", "time is up", "failed, lost", "unsafe"} <= set(outcomes)


def test_the_check_sees_a_write_that_is_too_fast(monkeypatch):
    from prefcal_env.worlds.live.plan import LiveKnob

    monkeypatch.setattr(LiveKnob, "step", lambda self, elapsed, period: 1e9)
    with pytest.raises(simulated_sessions.Broken, match="is faster than"):
        simulated_sessions.run(20)


def test_a_real_server_that_loses_its_connection_gets_its_old_values_back():
    pytest.importorskip("asyncua")
    from worlds.live.sessions import server_sessions

    found = server_sessions.run(60.0, most=4)
    assert found.ends.total() == 4
    assert found.writes
    assert found.broken == []


def test_the_check_of_a_real_server_sees_a_fast_write_and_a_late_restoration(monkeypatch):
    pytest.importorskip("asyncua")
    from prefcal_env.worlds.live.drive import Drive
    from prefcal_env.worlds.live.plan import LiveKnob
    from worlds.live.sessions import server_sessions

    with monkeypatch.context() as changed:
        changed.setattr(LiveKnob, "step", lambda self, elapsed, period: 1e9)
        found = server_sessions.run(60.0, most=6)
        assert any("is faster than" in words for words in found.broken)
    moved, calls = Drive._moved_to, []

    def late(self, targets):
        if not self.plant.connected:
            calls.clear()
        calls.append(self.writer.read() if self.plant.connected else None)
        return moved(self, targets) if not self.plant.connected or len(calls) > 6 else False

    monkeypatch.setattr(Drive, "_moved_to", late)
    found = server_sessions.run(60.0, most=12, first=7)
    assert any("idle samples" in words for words in found.broken)


@source_contract
def test_live_plant(clause, tmp_path, monkeypatch):
    plant = Memory()
    simulate_time(plant, monkeypatch)
    clause(memory_rig(plant, tmp_path), np.array([2.0, 20.0]))
