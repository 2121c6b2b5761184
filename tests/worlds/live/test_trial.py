"""Old and new tried on a live plant: whatever happens, it ends with what was confirmed, or as before."""

import json
import os
import re
import signal
import sys
import time
from contextlib import suppress
from dataclasses import replace
from shutil import copy

import numpy as np
import pytest

from prefcal_app.session import Background, Choice, Phase, actions
from prefcal_app.session.study import Recovery, tried_on_plant
from prefcal_app.summary import kept_on_plant
from prefcal_app.view import now_view, trial_view
from prefcal_app.web import Window
from prefcal_env import Knob
from prefcal_env.errors import StaleError, StudyError
from prefcal_env.sources import PlantTrial
from prefcal_env.study import StudyFile
from prefcal_env.worlds.live import Journal, LiveKnob
from prefcal_env.worlds.live.drive import Drive, Hands
from prefcal_scenarios.scenario import KPI, Scenario
from support.browser import Watched
from support.interviews import begin, reopened, until
from support.page_checks import serious
from support.talking import talk
from worlds.live.memory import Memory, memory_rig, simulate_time

BEFORE = {"kp": 1.0, "ti": 10.0, "sp": 1.0}


@pytest.fixture
def plant():
    return Memory()


@pytest.fixture
def scenario(plant, tmp_path, monkeypatch):
    simulate_time(plant, monkeypatch)
    return tank(plant, tmp_path)


def tank(plant, folder):
    rig = memory_rig(plant, folder)
    kpi = KPI("overshoot of level", "overshoot", "m", better="lower")
    return Scenario("tank", "A tank", rig.space, rig, kpis=(kpi,))


def finished(scenario, path=None, seed=0, unsafe=False):
    """A study of three runs, the second of which is the best."""
    interview = begin(scenario, n_max=3, seed=seed, path=path)
    while (now := worked(interview)).phase is not Phase.OVER:
        if now.phase is Phase.CONFIRM:
            interview.do(actions.WriteAndStart(now.pending.index))
            continue
        new = now.question.challenger.index == 1
        if unsafe and new:
            first = "right" if now.question.left.challenger else "left"
            interview.do(actions.Mark(now.question.id, first, "unsafe", True))
        side = "left" if now.question.left.challenger is new else "right"
        interview.do(actions.Answer(now.question.id, Choice(side)))
    return interview


def worked(interview):
    while interview.work():
        pass
    return interview.now()


def read(interview, blind=False):
    """Let the plant be read: what is seen before anything is written."""
    interview.do(actions.TryOnPlant(1, blind=blind))
    return worked(interview).plant.trial


def press(interview, plant, *keys, blind=False):
    """Read the plant, and press each key once it shows what was pressed before; then do all the work."""
    read(interview, blind)
    left = [key if callable(key) else actions.TryOnPlant(1, key, blind) for key in keys]

    def at(plant):
        trial = interview.now().plant.trial
        if left and trial is not None and trial.shown == trial.wanted:
            key = left.pop(0)
            key() if callable(key) else interview.do(key)

    interview.do(left.pop(0))
    plant.at = at
    now = worked(interview)
    plant.at = lambda plant: None
    assert not left
    return now


def keep(interview, index):
    return lambda: interview.do(actions.KeepOnPlant(index, 1))


def end(interview):
    return lambda: interview.do(actions.EndTrial())


def has(plant, interview, index=None):
    """Whether the plant has the θ of an experiment, or what it had before; the set-point is never moved."""
    theta = None if index is None else interview.now().state.history.samples[index].theta
    wanted = BEFORE if theta is None else {"kp": theta[0], "ti": theta[1], "sp": 1.0}
    return {name: plant.values[name] for name in BEFORE} == pytest.approx(wanted)


@pytest.mark.parametrize("index", [0, 1])
def test_old_and_new_are_written_in_turn_and_the_confirmed_one_stays(scenario, plant, tmp_path, index):
    interview, seen = finished(scenario, tmp_path / "mine.prefcal"), []
    assert has(plant, interview)

    def look():
        now = interview.now()
        at = now.plant.trial.shown
        seen.append((at, has(plant, interview, at), (tmp_path / "old.json").exists()))

    def other(index):
        return lambda: (look(), interview.do(actions.TryOnPlant(1, index)))

    now = press(interview, plant, 0, other(1), other(0), other(index), keep(interview, index))
    assert seen == [(0, True, True), (1, True, True), (0, True, True)]
    assert has(plant, interview, index)
    assert not (tmp_path / "old.json").exists()
    assert (now.state.kept[2].index, now.state.kept[2].blind) == (index, False)
    assert kept_on_plant(now.state)["which"] == ("old", "new")[index]
    interview.file.close()
    again = reopened(scenario, tmp_path / "mine.prefcal")
    worked(again)
    assert has(plant, again, index)


def test_nothing_is_written_before_the_person_has_seen_what_the_plant_has(scenario, plant):
    interview = finished(scenario)
    writes = len(plant.writes)
    with pytest.raises(StaleError, match="not known yet"):
        interview.do(actions.TryOnPlant(1, 0))
    trial = read(interview)
    assert [(change.name, change.old) for change in trial.changes] == [("K_p", 1.0), ("T_i", 10.0)]
    assert not interview.work()
    plant.values["kp"] = 1.2
    interview.do(actions.TryOnPlant(1, 0))
    assert "changed before they were confirmed" in worked(interview).plant.trial.problem
    assert len(plant.writes) == writes
    assert interview.now().plant.recovery is Recovery.DONE


def test_the_outputs_are_seen_as_they_come_those_of_one_side_at_a_time(scenario, plant):
    interview, seen = finished(scenario), []

    def wait(plant):
        now = interview.now()
        if now.plant.trial is not None and now.plant.trial.shown is not None:
            seen.append((now.plant.trial.shown, len(now.plant.times), len(now.plant.curves[0].values)))
            if len(now.plant.times) == 4:
                other = 1 - now.plant.trial.shown
                interview.do(actions.TryOnPlant(1, other) if other else actions.EndTrial())

    read(interview)
    interview.do(actions.TryOnPlant(1, 0))
    plant.at = wait
    worked(interview)
    longest = {side: max(each[1:] for each in seen if each[0] == side) for side in (0, 1)}
    assert longest == {0: (4, 4), 1: (4, 4)}


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda plant: plant.values.update(kp=7.0), "now the plant shows K_p = 7 instead of "),
        (lambda plant: plant.bad.add("kp"), "now the plant shows K_p = no good value instead of "),
        (lambda plant: setattr(plant, "up", False), "the plant cannot be read, so look what it has: no conn"),
    ],
)
def test_a_plant_that_has_something_else_when_new_is_confirmed_is_told(
    scenario, plant, tmp_path, change, said
):
    interview = finished(scenario)
    now = press(interview, plant, 1, lambda: (change(plant), keep(interview, 1)()))
    assert now.state.kept[2].index == 1  # it stands
    assert now.plant.trial.problem.startswith(f"it was confirmed, but {said}")
    assert "values from before" not in now.plant.trial.problem
    assert trial_view(interview, now)["live"]["problem"] == now.plant.trial.problem
    assert now.plant.recovery is Recovery.DONE
    assert not (tmp_path / "old.json").exists()


def test_a_trial_that_is_ended_leaves_what_the_plant_had(scenario, plant):
    interview = finished(scenario)
    now = press(interview, plant, 0, 1, end(interview))
    assert has(plant, interview)
    assert now.state.kept is None
    assert now.plant.trial.problem == "it was stopped. The plant has the values from before"
    assert press(interview, plant, 1, keep(interview, 1)).state.kept[2].index == 1


def test_a_plant_that_becomes_unsafe_gets_back_its_values_at_once(scenario, plant):
    interview = finished(scenario)
    now = press(interview, plant, 1, lambda: plant.values.update(level=9.0))
    assert has(plant, interview)
    assert "m is outside its abort limits [0, 3]" in now.plant.trial.problem
    with pytest.raises(StaleError, match="neither of the two now"):
        interview.do(actions.KeepOnPlant(1, 1))
    assert now.state.kept is None


def test_somebody_else_who_changes_a_knob_ends_the_trial(scenario, plant):
    interview = finished(scenario)
    now = press(interview, plant, 1, lambda: plant.values.update(kp=7.0))
    assert "K_p was changed on the plant to 7" in now.plant.trial.problem
    assert has(plant, interview)


def test_a_lost_connection_ends_the_trial_and_the_values_are_back_when_it_is_regained(scenario, plant):
    interview, lost_at = finished(scenario), plant.now

    def lose():
        plant.up = False
        plant.at = lambda plant: setattr(plant, "up", plant.now > lost_at + 500)

    read(interview)
    interview.do(actions.TryOnPlant(1, 1))
    plant.at = lambda plant: lose() if interview.now().plant.trial.shown == 1 else None
    now = worked(interview)
    assert "no connection to memory" in now.plant.trial.problem
    assert has(plant, interview)


def test_without_a_press_for_an_hour_the_values_from_before_are_back(scenario, plant):
    interview, began = finished(scenario), plant.now
    now = press(interview, plant, 1)
    assert "nothing was confirmed within 3600 s" in now.plant.trial.problem
    assert 3600 < plant.now - began < 3720
    assert has(plant, interview)


def test_values_that_take_longer_to_write_than_the_patience_are_on_the_plant_for_as_long(plant, tmp_path):
    sides = {0: np.array([9.0, 10.0]), 1: np.array([2.0, 10.0])}
    rig, trial, seen = memory_rig(plant, tmp_path), PlantTrial(sides, "a trial", lambda: False), []
    plant.at = lambda plant: seen.append(plant.now) if trial.shown == 0 else None
    hands = Hands(plant.clock, plant.sleep, confirm=lambda changes: True)
    drive = Drive(rig, {"K_p": 9.0, "T_i": 10.0}, rig.journal, hands, starts=False)
    assert drive.try_out(trial, 5.0) == ("nothing was confirmed within 5 s", True)
    assert seen[0] > 8.0  # from 1 to 9 at 1 per second
    assert seen[-1] - seen[0] == pytest.approx(5.0, abs=1.0)
    assert plant.values["kp"] == 1.0


def test_a_process_that_is_told_to_end_leaves_what_the_plant_had(scenario, plant):
    interview = finished(scenario)
    press(interview, plant, 1, interview.close)
    assert has(plant, interview)
    assert interview.now().state.kept is None
    assert not interview.drives


def test_an_unreachable_plant_is_said_and_costs_the_study_nothing(scenario, plant, tmp_path):
    interview = finished(scenario, tmp_path / "mine.prefcal")
    before, plant.up = interview.now().state, False
    trial = read(interview)
    assert "the server is not reachable" in trial.problem
    assert trial.changes is None
    with pytest.raises(StaleError, match="not known yet"):
        interview.do(actions.TryOnPlant(1, 1))
    assert interview.now().state == before
    assert not (tmp_path / "old.json").exists()
    plant.up = True
    assert press(interview, plant, 1, keep(interview, 1)).state.kept is not None


def test_a_second_command_on_the_plant_is_refused(scenario, plant, tmp_path):
    interview = finished(scenario)
    read(interview)
    writes = len(plant.writes)
    with Journal(tmp_path / "old.json").alone():
        interview.do(actions.TryOnPlant(1, 1))
        now = worked(interview)
        assert now.plant.recovery is Recovery.FAILED
        assert "another prefcal runs on this plant" in now.plant.problem
        with pytest.raises(StaleError, match="does not have its old values"):
            interview.do(actions.TryOnPlant(1))
    assert len(plant.writes) == writes
    interview.do(actions.Retry())
    worked(interview)
    assert press(interview, plant, 1, keep(interview, 1)).state.kept is not None


def test_on_a_full_disk_nothing_is_confirmed_and_the_old_values_come_back(scenario, plant, monkeypatch):
    interview = finished(scenario)

    def full(*events):
        raise StudyError("the disk is full")

    def fail():
        with monkeypatch.context() as patch:
            patch.setattr(interview.file, "append", full)
            with pytest.raises(StudyError, match="the disk is full"):
                interview.do(actions.KeepOnPlant(1, 1))
        assert interview.now().plant.trial.shown == 1  # it can be confirmed again

    now = press(interview, plant, 1, fail, end(interview))
    assert now.state.kept is None
    assert has(plant, interview)


@pytest.mark.parametrize("index", [1, 0])
def test_a_second_confirmation_is_refused_so_that_the_values_from_before_can_be_forgotten(
    scenario, plant, tmp_path, monkeypatch, index
):
    interview = finished(scenario, tmp_path / "mine.prefcal")

    def twice():
        interview.do(actions.KeepOnPlant(1, 1))
        with pytest.raises(StaleError, match="confirmed already"):
            interview.do(actions.KeepOnPlant(index, 1))

    with monkeypatch.context() as patch:  # as if it were killed before the values are forgotten
        patch.setattr(Journal, "settle", lambda self, mark: None)
        assert press(interview, plant, 1, twice).state.confirmed == 1
    interview.file.close()
    again = reopened(scenario, tmp_path / "mine.prefcal")
    worked(again)
    assert has(plant, again, 1)


def test_what_is_being_written_cannot_be_confirmed(scenario, plant):
    interview, refused = finished(scenario), []

    def early(plant):
        if interview.now().plant.trial is not None and interview.now().plant.trial.shown is None:
            with pytest.raises(StaleError, match="neither of the two"):
                interview.do(actions.KeepOnPlant(1, 1))
            refused.append(plant.now)
            if len(refused) > 2:
                interview.do(actions.EndTrial())

    read(interview)
    interview.do(actions.TryOnPlant(1, 1))
    plant.at = early
    assert worked(interview).state.kept is None
    assert refused


def test_nothing_else_is_done_while_the_plant_has_something_else_on_it(scenario, plant):
    interview = finished(scenario)

    def others():
        for action in (actions.GoOn(1), actions.Retract(1), actions.TryOnPlant(1)):
            with pytest.raises(StaleError, match=r"stop it first|tried already"):
                interview.do(action)

    press(interview, plant, 1, others, end(interview))


def test_a_first_experiment_that_was_unsafe_is_not_written_again(scenario):
    interview = finished(scenario, unsafe=True)
    with pytest.raises(StaleError, match="first experiment was unsafe"):
        interview.do(actions.TryOnPlant(1))
    assert trial_view(interview, interview.now()) is None


def test_an_answer_that_is_retracted_after_the_plant_was_read_is_a_reason_to_read_it_again(scenario):
    interview = finished(scenario)
    read(interview)
    interview.do(actions.Retract(2))
    with pytest.raises(StaleError, match="not known yet"):
        interview.do(actions.TryOnPlant(1, 1))


def test_values_from_before_that_cannot_be_forgotten_do_not_undo_what_was_confirmed(
    scenario, plant, monkeypatch, tmp_path
):
    interview = finished(scenario)

    def stuck(self):
        raise OSError(13, "Permission denied")

    with monkeypatch.context() as patch:
        patch.setattr(Journal, "clear", stuck)
        now = press(interview, plant, 1, keep(interview, 1))
        assert now.plant.recovery is Recovery.FAILED
        assert "were confirmed, but those from before are still in" in now.plant.problem
        assert has(plant, interview, 1)
    interview.do(actions.Retry())
    assert worked(interview).plant.recovery is Recovery.DONE
    assert has(plant, interview, 1)
    assert not (tmp_path / "old.json").exists()


def test_another_study_restores_the_values_from_before_a_trial_that_was_not_its_own(scenario, plant):
    interview = finished(scenario)
    interview.do(actions.GoOn(1))
    Journal(scenario.source.journal.path).save({"K_p": 3.0, "T_i": 10.0}, "a trial of another study")
    worked(reopened_like(scenario))
    assert plant.values["kp"] == pytest.approx(3.0)


def killed_before_they_are_forgotten(scenario, plant, path, monkeypatch):
    """A study in which new is confirmed, and the values from before are still in their file."""
    interview = finished(scenario, path)
    with monkeypatch.context() as patch:
        patch.setattr(Journal, "settle", lambda self, mark: None)
        press(interview, plant, 1, keep(interview, 1))
    interview.file.close()


def test_values_are_not_forgotten_while_another_process_runs_on_the_plant(
    scenario, plant, tmp_path, monkeypatch
):
    path, old = tmp_path / "mine.prefcal", tmp_path / "old.json"
    killed_before_they_are_forgotten(scenario, plant, path, monkeypatch)
    kept = old.read_bytes()
    with Journal(old).alone():
        again = reopened(scenario, path)
        assert "another prefcal runs on this plant" in worked(again).plant.problem
        assert old.read_bytes() == kept
    again.do(actions.Retry())
    assert worked(again).plant.recovery is Recovery.DONE
    assert has(plant, again, 1)
    assert not old.exists()


def test_a_copy_of_a_study_does_not_forget_the_values_from_before_a_trial_of_the_original(
    scenario, plant, tmp_path, monkeypatch
):
    mine, copied, old = tmp_path / "mine.prefcal", tmp_path / "copied.prefcal", tmp_path / "old.json"
    finished(scenario, mine).file.close()
    copy(mine, copied)
    theirs = reopened(scenario, copied)
    worked(theirs)
    assert press(theirs, plant, 1, keep(theirs, 1)).state.confirmed == 1
    theirs.file.close()
    plant.values.update(BEFORE)
    interview = reopened(scenario, mine)
    worked(interview)
    with monkeypatch.context() as patch:  # as if it were killed in the midst of its first trial
        patch.setattr(Drive, "restore", lambda self: True)
        press(interview, plant, 1, end(interview))
    interview.file.close()
    assert old.exists()
    again = reopened(scenario, copied)
    worked(again)
    assert has(plant, again)
    assert not old.exists()


def reopened_like(scenario):
    return begin(scenario, n_max=3, seed=1)


# --- Blind: nothing that is shown, and no time that passes, tells which of the two is which.


def test_a_blind_trial_of_a_live_plant_shows_no_theta_and_names_no_side(scenario, plant):
    interview, texts = finished(scenario), []

    def look():
        view = trial_view(interview, interview.now())
        assert [set(side) for side in view["blind"]] == [{"index", "name", "theta"}] * 2
        assert [(side["name"], side["theta"]) for side in view["blind"]] == [("A", []), ("B", [])]
        texts.append(json.dumps(now_view(interview)["live"]))

    read(interview, blind=True)
    rows = trial_view(interview, interview.now())["live"]["changes"]
    theta = [interview.now().state.history.samples[index].theta for index in (0, 1)]
    for row, pair in zip(rows, zip(*theta, strict=True), strict=True):
        assert row["new"] == " or ".join(f"{value:.6g}" for value in sorted(pair))
    order = tried_on_plant(interview.now().state, 1)
    switch = actions.TryOnPlant(1, order[1], blind=True)
    kept = actions.KeepOnPlant(order[1], 1)
    now = press(
        interview,
        plant,
        order[0],
        lambda: (look(), interview.do(switch)),
        lambda: (look(), interview.do(kept)),
        blind=True,
    )
    assert (now.state.kept[2].index, now.state.kept[2].blind) == (order[1], True)
    assert '"changes": null' in texts[0]


@pytest.mark.parametrize("has_old", [True, False])
def test_writing_takes_equally_long_whichever_of_the_two_the_plant_had(scenario, plant, has_old):
    interview = finished(scenario)
    if has_old:  # so that nothing is to be written for old
        theta = interview.now().state.history.samples[0].theta
        plant.values.update(kp=theta[0], ti=theta[1])
    taken = {}
    for first in (0, 1):
        read(interview)
        interview.do(actions.TryOnPlant(1, first))
        began, times = plant.now, []

        def note(plant, times=times, first=first):
            trial = interview.now().plant.trial
            if trial is not None and trial.shown == trial.wanted:
                times.append(plant.now)
                other = actions.TryOnPlant(1, 1 - first)
                interview.do(other if trial.shown == first else actions.EndTrial())

        plant.at = note
        worked(interview)
        plant.at = lambda plant: None
        taken[first] = [round(b - a, 6) for a, b in zip([began, *times], times, strict=False)]
    assert taken[0] == taken[1]
    assert len(taken[0]) == 2


# --- A process that is killed at any step: the study and the plant agree once it is opened again.


def killed_at(step, plant, scenario, path, values, *, index):
    """Try old and new in a process that is killed at a step; return whether it was."""
    pid = os.fork()
    if pid:
        return os.WIFSIGNALED(os.waitpid(pid, 0)[1])
    left = [step]

    def tick():
        values.write_text(json.dumps(plant.values))
        if not left[0]:
            os.kill(os.getpid(), signal.SIGKILL)
        left[0] -= 1

    def around(owner, name):
        real = getattr(owner, name)

        def killable(*given, **named):
            tick()
            made = real(*given, **named)
            tick()
            return made

        setattr(owner, name, killable)

    with suppress(BaseException):
        interview = reopened(scenario, path)
        worked(interview)
        for owner, name in ((plant, "write"), (Journal, "save"), (Journal, "clear"), (StudyFile, "append")):
            around(owner, name)
        press(interview, plant, 1 - index, index, keep(interview, index))
        tick()
        os._exit(0)
    os._exit(1)


@pytest.mark.skipif(sys.platform == "win32", reason="forks, and sends POSIX signals")
@pytest.mark.parametrize("index", [0, 1])
def test_a_trial_that_is_killed_at_any_step_leaves_study_and_plant_that_agree(
    scenario, plant, tmp_path, index
):
    path, values, ends = tmp_path / "mine.prefcal", tmp_path / "values.json", set()
    rates = (("K_p", "kp", 0.5, 20.0, 9.0), ("T_i", "ti", 1.0, 60.0, 30.0))
    knobs = tuple(LiveKnob(Knob(name, low, high), node, rate) for name, node, low, high, rate in rates)
    rig = memory_rig(plant, tmp_path, knobs=knobs)
    scenario = replace(scenario, space=rig.space, run=rig)
    finished(scenario, path).file.close()
    kept, step, was_killed = path.read_bytes(), 0, True
    while was_killed:
        path.write_bytes(kept)
        plant.values.update(BEFORE)
        was_killed = killed_at(step, plant, scenario, path, values, index=index)
        plant.values.update(json.loads(values.read_text()))
        after = dict(plant.values)
        again = reopened(scenario, path)
        assert worked(again).plant.recovery is Recovery.DONE
        confirmed = again.now().state.kept
        assert has(plant, again, None if confirmed is None else confirmed[2].index), step
        assert not (tmp_path / "old.json").exists()
        ends.add((confirmed is not None, after == plant.values))
        again.file.close()
        step += 1
    assert confirmed[2].index == index
    assert step > 15
    # Killed before anything was written, with something else on the plant, and after the confirmation.
    assert {(False, True), (False, False), (True, True)} <= ends


# --- The terminal.


def test_the_terminal_writes_switches_and_confirms(scenario, plant):
    interview = finished(scenario)
    out = talk(interview, "", ["t", "yes", "o", "keep"])
    assert interview.now().state.kept[2].index == 1
    assert has(plant, interview, 1)
    for words in (
        "K_p: 1 → ",
        " or ",
        "limits 0.5 to 20, at most 1 per second",
        "New: experiment 2 is on the",
    ):
        assert words in out
    assert "Confirmed on the plant: new (experiment 2)" in out


def test_the_terminal_says_that_the_plant_has_something_else_than_what_was_confirmed(scenario, plant):
    interview = finished(scenario)
    record = interview.file.append

    def changed(*events):
        plant.values["kp"] = 7.0
        return record(*events)

    interview.file.append = changed
    out = talk(interview, "", ["t", "yes", "o", "keep"])
    assert "Confirmed on the plant: new (experiment 2)" in out
    assert "it was confirmed, but now the plant shows K_p = 7 instead of " in " ".join(out.split())


@pytest.mark.parametrize(
    "lines", [["t", ""], ["t", "yes", ""], ["b", "yes", "o", "x"], ["t", "yes", "o", "o", ""]]
)
def test_the_terminal_leaves_what_the_plant_had_unless_it_was_confirmed(scenario, plant, lines):
    interview = finished(scenario)
    writes = len(plant.writes)
    out = talk(interview, "", lines)
    assert interview.now().state.kept is None
    assert has(plant, interview)
    assert ("The plant has the values from before" in out) == (len(lines) > 2)
    assert (len(plant.writes) == writes) == (len(lines) == 2)


def test_the_terminal_says_that_the_plant_is_not_reachable(scenario, plant):
    interview = finished(scenario)
    plant.up = False
    out = talk(interview, "", ["t"])
    assert "the server is not reachable: no connection to memory" in out
    assert "Nothing was written." in out


# --- The page.


@pytest.fixture
def page(scenario, plant, tmp_path, monkeypatch, browser):
    """The page at the end of a study, on a plant whose seconds pass faster than those of the browser."""
    finished(scenario, tmp_path / "mine.prefcal").file.close()
    passing = plant.sleep

    def sleep(seconds):
        time.sleep(seconds / 10)
        passing(seconds)

    monkeypatch.setattr(plant, "sleep", sleep)
    interview = reopened(scenario, tmp_path / "mine.prefcal")
    with Window(interview) as window, Background(interview):
        watched = Watched(browser)
        watched.page.goto(window.link)
        watched.phase("over")
        yield watched, interview
        assert watched.errors == []
    interview.file.close()


def on_plant(page, name):
    """Wait until the page says that the plant has a side."""
    page.wait_for_function(
        "name => document.getElementById('trial-side')?.textContent.includes(name)"
        " && document.getElementById('trial-stage').textContent.includes('on the plant')",
        arg=name,
        timeout=60_000,
    )


def test_on_the_page_old_and_new_are_one_key_apart_and_one_stays(page, plant):
    watched, interview = page
    shown = watched.page
    writes = len(plant.writes)
    shown.click("#trial-open")
    shown.wait_for_selector("#trial-write")
    assert " or " in shown.inner_text("#trial-place table")
    assert len(plant.writes) == writes
    watched.shot("live-trial-confirm")
    shown.click("#trial-write")
    on_plant(shown, "Old: first experiment (experiment 1)")
    shown.wait_for_selector("#trial-curves polyline.output")
    shown.keyboard.press("o")
    on_plant(shown, "New: experiment 2")
    assert has(plant, interview, 1)
    shown.keyboard.press("o")
    on_plant(shown, "Old: first experiment")
    shown.click("#trial-switch")
    on_plant(shown, "New: experiment 2")
    assert serious(shown) == []
    watched.shot("live-trial")
    shown.click("#trial-keep")
    shown.wait_for_selector("dialog:not([open])", state="attached", timeout=60_000)
    shown.wait_for_selector("text=Confirmed on the plant: new (experiment 2)")
    assert interview.now().state.kept[2].index == 1
    assert has(plant, interview, 1)


def test_the_page_closes_what_it_asks_about_the_plant_when_more_is_asked_elsewhere(page):
    watched, interview = page
    watched.page.click("#trial-open")
    watched.page.wait_for_selector("#trial-write")
    interview.do(actions.GoOn(1))
    watched.page.wait_for_selector("dialog:not([open])", state="attached")
    assert interview.now().phase is not Phase.OVER


def test_the_page_says_that_the_plant_has_something_else_than_what_was_confirmed(page, plant):
    watched, interview = page
    shown = watched.page
    shown.click("#trial-open")
    shown.click("#trial-write")
    on_plant(shown, "Old: first experiment")
    record = interview.file.append

    def changed(*events):
        plant.values["kp"] = 7.0
        return record(*events)

    interview.file.append = changed
    shown.click("#trial-keep")
    shown.wait_for_selector("#trial-place [role=alert]")
    text = shown.inner_text("#trial-place")
    assert text.startswith("it was confirmed, but now the plant shows K_p = 7 instead of ")
    shown.click("#trial-place button:text-is('Close')")
    shown.wait_for_selector("text=Confirmed on the plant: old (experiment 1)")


@pytest.mark.parametrize("how", ["k", "Escape", "reload"])
def test_on_the_page_a_blind_trial_that_is_left_restores_the_plant(page, plant, how):
    watched, interview = page
    shown = watched.page
    shown.click("#trial-blind")
    shown.click("#trial-write")
    on_plant(shown, "A")
    text = shown.inner_text("#dialog")
    assert not re.search("Old|New|experiment", text)
    watched.shot("live-trial-blind")
    if how == "reload":  # it is shown again as it was, and left then
        shown.reload()
        on_plant(shown, "A")
        behind = shown.eval_on_selector("#dialog", "it => getComputedStyle(it, '::backdrop').backgroundColor")
        assert behind.startswith("rgb("), "the result behind would tell A from B"
        shown.click("#trial-end")
    else:
        shown.keyboard.press(how)
    until(interview, lambda now: not now.plant.trial.moves)
    assert has(plant, interview)
    assert interview.now().state.kept is None
    if how == "k":
        shown.wait_for_selector("text=The plant has the values from before")
