"""The result of a rig is tried on the plant, openly or blind, and what is confirmed stays in the study."""

import json
import os
import re
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from shutil import copy

import pytest

from prefcal_app.report.export import best_as_json
from prefcal_app.report.write import sheet
from prefcal_app.session import Choice, Phase, actions
from prefcal_app.session.study import tried_on_plant
from prefcal_app.summary import kept_on_plant, kept_text
from prefcal_app.view import now_view, trial_view
from prefcal_env.errors import StaleError, StudyError
from prefcal_env.sources.rig import Rig
from prefcal_env.study import StudyFile, verify
from support.interviews import begin, proceed, reopened
from support.talking import talk
from toy_scenario_tools import CHANNELS, csv
from toy_study import toy_record, toy_scenario

RIG = replace(toy_scenario(), cost=None, references={}, kpis=(), run=Rig(CHANNELS, (2.0,)))


def finished(seed=0, path=None, better=True):
    """A study of three records; the second one is better than the first, or none is."""
    return played(begin(RIG, n_max=3, seed=seed, path=path), better)


def played(interview, better=True):
    while (now := proceed(interview)).phase is not Phase.OVER:
        if now.phase is Phase.RECORD:
            interview.do(actions.Record(now.pending.index, csv(5.0 + now.pending.index)))
        else:
            new = now.question.challenger.index == 1 and better
            side = "left" if (now.question.left.challenger) is new else "right"
            interview.do(actions.Answer(now.question.id, Choice(side)))
    return interview


@pytest.mark.parametrize(("choice", "index"), [("old", 0), ("new", 1)])
def test_what_is_confirmed_is_in_the_file_of_a_study_that_is_killed_right_then(tmp_path, choice, index):
    interview = finished(path=tmp_path / "a.prefcal")
    interview.do(actions.KeepOnPlant(index, 1))
    killed = tmp_path / "killed"
    killed.mkdir()
    for file in tmp_path.glob("a.prefcal*"):  # as it is on the disk while the other one still runs
        copy(file, killed)
    again = reopened(RIG, killed / "a.prefcal")
    kept = again.now().state.kept[2]
    assert (kept.index, kept.blind) == (index, False)
    view = trial_view(again, again.now())
    assert f"Confirmed on the plant: {choice} (experiment {index + 1})" in view["kept"]


def test_on_a_full_disk_nothing_is_confirmed(monkeypatch):
    interview = finished()

    def full(self, *events):
        raise StudyError("the disk is full")

    with monkeypatch.context() as patch:
        patch.setattr(StudyFile, "append", full)
        with pytest.raises(StudyError, match="full"):
            interview.do(actions.KeepOnPlant(1, 1))
    assert interview.now().state.kept is None


def test_a_blind_trial_shows_values_and_nothing_else_by_which_old_and_new_are_known():
    firsts = set()
    for seed in range(8):
        interview = finished(seed)
        now = interview.now()
        sides = tried_on_plant(now.state, now.incumbent)
        shown = trial_view(interview, now)["blind"]
        assert [side["name"] for side in shown] == ["A", "B"]
        assert all(set(side) == {"index", "name", "theta"} for side in shown)
        assert not re.search(
            "old|new|best|experiment", json.dumps([(side["name"], side["theta"]) for side in shown])
        )
        interview.do(actions.KeepOnPlant(shown[1]["index"], 1, blind=True))
        kept = interview.now().state.kept[2]
        assert (kept.index, kept.blind) == (sides[1], True)
        firsts.add(sides[0])
    assert firsts == {0, 1}


def test_the_next_blind_trial_is_in_an_order_of_its_own():
    interview, orders = finished(), set()
    for _ in range(8):
        orders.add(tried_on_plant(interview.now().state, 1))
        interview.do(actions.KeepOnPlant(1, 1))
    assert len(orders) == 2


def test_what_was_seen_is_what_is_confirmed_although_the_order_is_another_one_by_now():
    for seed in range(6):
        interview = finished(seed)
        seen = trial_view(interview, interview.now())["blind"][0]
        interview.do(actions.KeepOnPlant(1, 1))  # in another window
        interview.do(actions.KeepOnPlant(seen["index"], 1, blind=True))
        kept = interview.now().state.kept[2]
        assert (kept.index, kept.blind) == (seen["index"], True)


def test_a_confirmation_that_was_withdrawn_has_told_its_order_so_the_next_one_is_another():
    orders = []
    for seed in range(6):
        interview = finished(seed)
        orders.append([tried_on_plant(interview.now().state, 1)])
        for _ in range(3):
            interview.do(actions.KeepOnPlant(1, 1, blind=True))
            interview.do(actions.GoOn(1))  # withdraws it
            interview.do(actions.Finish())
            orders[-1].append(tried_on_plant(interview.now().state, 1))
    assert all(None not in each for each in orders)
    for k in range(3):  # in some studies each order is another one than that before
        assert any(each[k + 1] != each[k] for each in orders)
        assert any(each[k + 1] == each[k] for each in orders)


def test_only_what_was_tried_is_confirmed():
    interview = finished()
    with pytest.raises(StaleError, match="experiment 3 was not tried"):
        interview.do(actions.KeepOnPlant(2, 1))


def test_a_result_that_is_another_one_by_now_is_not_confirmed():
    interview = finished()
    with pytest.raises(StaleError, match="another experiment is the best"):
        interview.do(actions.KeepOnPlant(1, 2))


def test_without_a_better_experiment_nothing_is_offered():
    interview = finished(better=False)
    now = interview.now()
    assert "keep_on_plant" not in now.can
    assert now_view(interview)["over"]["trial"] is None


def test_going_on_withdraws_the_confirmation():
    interview = finished()
    interview.do(actions.KeepOnPlant(1, 1))
    interview.do(actions.GoOn(1))
    assert interview.now().state.kept is None


def test_a_retraction_that_makes_old_the_best_withdraws_that_new_was_confirmed():
    interview = finished()
    interview.do(actions.KeepOnPlant(1, 1))
    interview.do(actions.Retract(1))
    now = interview.now()
    assert (now.phase, now.incumbent, now.state.kept) == (Phase.OVER, 0, None)


def test_sheet_and_best_json_say_what_is_kept():
    kept = {"which": "old", "experiment": 1, "blind": True, "by": "Ada", "at": "2026-01-01T10:11:12+00:00"}
    told = "Confirmed on the plant: old (experiment 1), tried blind, by Ada on 2026-01-01 at 10:11 UTC."
    assert kept_text(kept) == told
    with_it = replace(toy_record(), kept=kept)
    assert told in sheet(with_it).replace("\xa0", " ")
    assert json.loads(best_as_json(with_it))["kept"] == kept
    assert "On the plant" not in sheet(toy_record())
    assert "kept" not in json.loads(best_as_json(toy_record()))


@pytest.mark.parametrize("lines", [["b", "o", "keep"], ["t", "o", "o", "keep"]])
def test_the_terminal_switches_and_confirms(lines):
    interview = finished()
    out = talk(interview, "", lines)
    kept = interview.now().state.kept[2]
    expected = tried_on_plant(finished().now().state, 1)[1] if lines[0] == "b" else 0
    assert (kept.index, kept.blind) == (expected, lines[0] == "b")
    assert kept_text(kept_on_plant(interview.now().state)) in out


KILLED = f"""
import os, signal, sys
from pathlib import Path
sys.path[:0] = {[str(Path(__file__).parent), str(Path(__file__).parents[2])]!r}
from rich.console import Console
from prefcal_app.session import Background
from prefcal_app.terminal import converse
from prefcal_env.study import Kept, StudyFile
from support.interviews import reopened
from test_on_the_plant import RIG
append, written = StudyFile.append, sys.argv[2] == "written"
def killed(self, *entries):
    if not isinstance(entries[0], Kept):
        return append(self, *entries)
    if written:
        append(self, *entries)
    os.kill(os.getpid(), signal.SIGKILL)
StudyFile.append = killed
interview, lines = reopened(RIG, Path(sys.argv[1])), iter(["t", "o", "keep"])
with Background(interview):
    converse(interview, Console(width=140), lambda words: next(lines))
"""


@pytest.mark.parametrize("written", [False, True])
def test_a_process_that_is_killed_before_it_shows_what_was_confirmed(tmp_path, written):
    path = tmp_path / "a.prefcal"
    finished(path=path).file.close()
    words = [sys.executable, "-c", KILLED, str(path), "written" if written else "pressed"]
    searched = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run(words, capture_output=True, text=True, env=searched, timeout=120)
    assert done.returncode == -signal.SIGKILL, done.stderr
    assert "New: experiment 2: enter" in done.stdout
    assert "Confirmed on the plant" not in done.stdout
    assert verify(path) == ()
    again = reopened(RIG, path)
    trial = trial_view(again, again.now())
    assert trial["kept"].startswith("Confirmed on the plant: new (experiment 2)") == written
    assert (trial["kept"] == "") != written
    again.do(actions.KeepOnPlant(0, 1))  # it can be tried again
    assert again.now().state.kept[2].index == 0


@pytest.mark.parametrize("lines", [[""], ["x", ""], ["t", ""], ["t", "kepe", ""], ["b", ""]])
def test_the_terminal_confirms_nothing_by_itself(lines):
    interview = finished()
    out = talk(interview, "", lines)
    assert interview.now().state.kept is None
    assert ("Nothing more is confirmed." in out) == (lines[0] in ("t", "b"))
