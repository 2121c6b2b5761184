"""`prefcal verify`: what it prints, keeps and asks, and when it ends with an error."""

import json
import math
import re
import shlex
import signal

import pytest

from prefcal_app.cli import look_run
from prefcal_scenarios.verification.said import Verified
from support.processes import start

LAG = {"K": 2.0, "T_i": 20.0, "T_d": 3.0, "T_f": 3.0, "b": 0.5, "T_t": 20.0}


@pytest.fixture
def best(tmp_path):
    """Write the best.json of a study of the heat exchanger."""

    def write(**changes):
        content = {"format": 1, "scenario": "lag", "theta": LAG, "settings": {}, **changes}
        (tmp_path / "best.json").write_text(json.dumps(content))
        return "best.json"

    return write


def test_a_table_beside_the_tuning_before_with_statement_margins_and_worst_runs(prefcal, best, tmp_path):
    calm, before = {**LAG, "K": 1.0}, {"what": "current tuning", "theta": {**LAG, "K": 0.8}}
    (tmp_path / "acceptance.html").write_text("A sheet: <!-- verified -->not verified<!-- end -->")
    code, out, err = prefcal("verify", best(theta=calm, before=before), "--runs", "20", "--jobs", "1")
    assert code == 0, err
    words = " ".join(out.split())
    for text in (
        "Does it hold? Not judged, since no limit on runs is stated: 20 of 20 runs end safely and settle.",
        "Usual limits: ",
        "below 14 % with 95 % confidence",
        "No limit that a run can break is stated. What counts: a safe end",
        "The nominal run holds. To judge it by the usual limits, run: prefcal verify best.json --runs 20",
        "What margin has it?",
        "No limit on a margin is stated. Usual are M_s ≤ 2",
        "Before (current tuning): 20 of 20 of the same plants.",
        "phase margin [°]",
        "gain margin [dB]",
        "most different from nominal, but holds: ",
        "the sampled loop",
        "What hurts most, one at a time:",
        "Worst runs:",
        "what varied between range is time constant of 0.9 to 1.1 times the usual temperature modeled",
        "range of valve 0.9 to 1 times the usual, no effect alone stated",
        "backlash 0 to 0.01 of the range usual, whole gap;",
        "what was not varied why",
        "sampling jitter a period has one length here",
        "Kept in",
    ):
        assert text in words
    assert "current" in words
    kept = Verified.read(tmp_path)
    assert kept.statement in words
    sheet = (tmp_path / "acceptance.html").read_text(encoding="utf-8").replace("\xa0", " ")
    assert kept.statement in sheet
    assert (kept.runs, kept.planned, kept.share, kept.baseline) == (20, 20, 1.0, "current tuning")
    assert {len(row) for row in kept.kpis} == {8}
    assert [len(row) for row in kept.margins] == [3] * 5
    assert len(kept.effects) == len(kept.varied)
    assert [each.verdict for each in kept.worst] == [""] * 3
    assert all((tmp_path / f"worst_run_{k}.png").stat().st_size > 10_000 for k in (1, 2, 3))


def test_a_plant_that_changed_since_the_study_is_named_first(prefcal, tmp_path, monkeypatch):
    code = "from prefcal_env import Plant\nplant = Plant.of(([{}], [20, 1]), delay=6.0)\n"
    (tmp_path / "own.py").write_text(code.format(0.8))
    study = ("--calibrator", "synthetic", "--cost", "settling_time", "--simulate", "0", "--n-max", "3")
    done, _, err = prefcal("calibrate", "pid", "--plant", "own.py:plant", *study, "--out", "o")
    assert done == 0, err
    words = ("verify", "o/best.json", "--runs", "3", "--jobs", "1")
    _, same, _ = prefcal(*words)
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    _, moved, _ = prefcal("verify", "../o/best.json", *words[2:])
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own.py").write_text(code.format(1.3))
    _, other, _ = prefcal(*words)
    first = "Of the plant as its files are now, not as in the study."
    assert all(first not in " ".join(text.split()) and "Does it hold?" in text for text in (same, moved))
    assert f"Does it hold? {first}" in " ".join(other.split())


def test_the_line_that_is_offered_works_when_pasted_and_begins_no_study(prefcal, best, tmp_path):
    changed = ("--range", "dead time=0:0.3", "--range", "task=0")
    _, out, _ = prefcal("verify", best(), "--runs", "6", "--jobs", "1", *changed)
    (line,) = Verified.read(tmp_path).lines
    assert line in out
    program, *words = shlex.split(line)
    assert (program, words[:2]) == ("prefcal", ["verify", "best.json"])
    code, out, err = prefcal(*words, "--jobs", "1")
    assert code == 0, err
    kept = Verified.read(tmp_path)
    assert [text.partition(" <=")[0] for text in kept.limits] == ["overshoot", "settling_time"]
    assert "Not judged" not in out
    assert ("dead time", "6 to 7.8 s", "stated") in kept.varied
    assert kept.runs == 6
    assert {path.name for path in tmp_path.iterdir() if path.is_dir() or path.suffix == ".db"} == set()


def test_fewer_runs_than_before_are_shown_and_kept_beside(prefcal, best, tmp_path):
    prefcal("verify", best(), "--runs", "5", "--jobs", "1")
    code, out, err = prefcal("verify", "best.json", "--runs", "4", "--jobs", "1")
    assert code == 0, err
    words = " ".join(out.split())
    assert "3 of 4 runs end safely and settle" in words
    assert (
        "Kept in verification-4-runs.json: verification.json has more runs than these 4, so it stays, as do "
        "sheet and report. To replace it, remove it first."
    ) in words
    assert Verified.read(tmp_path).runs == 5


def test_each_bar_says_what_it_runs(prefcal, best):
    theta = {**LAG, "K": 7.0, "T_i": 8.0}
    best(theta=theta)
    given = "verify", ".", "--runs", "10", "--jobs", "1", "--limit", "overshoot <= 1 %"
    code, _, err = prefcal(*given, "--range", "dead time=0.5:0.8")
    assert code == 0, err
    assert "varied runs" in err
    assert "task as stated, other tunings" in err


def test_in_a_terminal_each_of_the_worst_runs_is_asked_about_once(prefcal, best, tmp_path, monkeypatch):
    said, answers = [], iter(["y", "N", "?"])

    def ask(console, words):
        said.append(words)
        return next(answers)

    monkeypatch.setattr(look_run, "ask_line", ask)
    monkeypatch.setattr("sys.stdin.isatty", lambda: True)
    theta = {**LAG, "K": 7.0, "T_i": 8.0}
    words = ("--range", "task=0", "--range", "dead time=0.5:0.8")
    code, _, err = prefcal("verify", best(theta=theta), "--runs", "10", "--jobs", "1", *words)
    assert code == 0, err
    kept = Verified.read(tmp_path)
    assert [each.verdict for each in kept.worst] == ["acceptable", "not acceptable", ""]
    assert all("acceptable? (y/n)" in text for text in said)
    assert ("dead time", "9 to 10.8 s", "stated") in kept.varied
    assert not any("load" in name for name, *_ in kept.varied)


RIG = """
from prefcal_env import Channel, Knob, KnobSpace, Rig
from prefcal_env.experiments.experiment import Channels
from prefcal_scenarios import KPI, Scenario

level = Channel("level", "m")


class Live(Rig):
    asks = "confirm"


def scenario(kind):
    rig = kind(Channels((level,), (), (level,), "h"), (2.0,), kpis=lambda made: {"overshoot": 0.0})
    kpis = (KPI("overshoot", "overshoot", at_most=5.0),)
    return Scenario("tank", "A tank", KnobSpace([Knob("K", 0, 5)]), rig, kpis=kpis)


record, confirm = scenario(Rig), scenario(Live)
"""


@pytest.mark.parametrize("kind", ["record", "confirm"])
def test_of_a_rig_only_its_limits_are_said(prefcal, best, tmp_path, kind):
    (tmp_path / "tank.py").write_text(RIG)
    changes = {"scenario": f"tank.py:{kind}", "theta": {"K": 2.0}, "kpis": {"overshoot": 7.0}}
    code, out, err = prefcal("verify", best(**changes, ended="time is up"))
    assert code == 0, err
    words = " ".join(out.split())
    for text in (
        "Not verified: nothing can be varied.",
        "The nominal run: overshoot 7, required ≤ 5.",
        "No margins: the plant is not known as equations",
        "a rig or a live plant, which cannot be varied: verify a model of it",
    ):
        assert text in words
    assert Verified.read(tmp_path).share is None


@pytest.mark.parametrize(
    ("changes", "words", "says"),
    [
        ({"theta": {"K": 2.0}}, (), "must name the knobs"),
        ({"scenario": "camel"}, (), "no scenario is called 'camel'"),
        ({}, ("--runs", "0"), "runs must be"),
        ({}, ("--range", "noise"), "--range must look like"),
        ({}, ("--range", "nosie=0"), "nothing that varies is called 'nosie'. Did you mean 'noise'?"),
    ],
)
def test_errors_of_use_say_what_is_wrong(prefcal, best, changes, words, says):
    code, _, err = prefcal("verify", best(**changes), *words)
    assert code != 0
    assert says in " ".join(err.split())


def test_a_log_counts_the_runs_and_what_ran_before_kill_counts(best, tmp_path):
    process = start(tmp_path, "verify", best(), "--runs", "2000", "--jobs", "1")
    try:
        said = re.fullmatch(r"varied runs: (\d+) of (\d+)\n", process.stderr.readline())
        assert int(said[1]) == math.ceil(int(said[2]) / 10)
        process.send_signal(signal.SIGTERM)
        out, err = process.communicate(timeout=60)
    finally:
        process.kill()
    assert process.returncode == 0, err
    assert "(stopped early, 2000 were planned)" in " ".join(out.split())
    assert 200 < Verified.read(tmp_path).runs < 2000
