"""Which studies stay: none of an aborted start, all with an answer; and how they are removed."""

import io
import json
import subprocess
import sys
from pathlib import Path

import pytest

from prefcal_app.terminal import converse
from prefcal_env.disk import digest_of
from prefcal_env.study import study_path
from support.studies import state_of
from toy_study import TOY

SYNTHETIC = ["--calibrator", "synthetic", "--agent", "random", "--n-max", "4"]


@pytest.fixture
def ours(monkeypatch):
    """The toy counts as a scenario of ours, whose experiments are cheap simulations."""
    monkeypatch.setattr("prefcal_app.cli.choices.is_built_in", lambda source: source == TOY)


def start(prefcal, monkeypatch, typed, *words):
    monkeypatch.setattr("sys.stdin", io.StringIO(typed))
    return prefcal("calibrate", TOY, "--terminal", "--n-max", "4", "--n-init", "2", *words)


def names(prefcal):
    return [row["study"] for row in json.loads(prefcal("studies", "list", "--json")[1])]


def test_an_aborted_start_leaves_neither_a_study_nor_a_folder(prefcal, monkeypatch, ours, tmp_path):
    code, out, err = start(prefcal, monkeypatch, "")
    assert code == 0, err
    assert "No answer was given, so study toy-1 was not kept" in err
    assert "Report" not in out
    assert names(prefcal) == []
    assert list(tmp_path.glob("prefcal-*")) == []


@pytest.mark.parametrize("typed", ["l\n", "l\nz\n"])  # z takes the answer back: it was given
def test_a_study_stays_from_its_first_answer_on(prefcal, monkeypatch, ours, typed):
    start(prefcal, monkeypatch, typed)
    assert names(prefcal) == ["toy-1"]
    sheet = Path("prefcal-toy-1", "acceptance.html").read_text(encoding="utf-8")
    assert f"SHA-256 of the study file: {digest_of(study_path('toy-1'))}" in sheet


def test_the_study_keeps_who_answered_and_the_sheet_says_it(prefcal, monkeypatch):
    start(prefcal, monkeypatch, "l\n", "--by", "Ada <Lovelace>")
    sheet = Path("prefcal-toy-1", "acceptance.html")
    assert "1 comparison by Ada &lt;Lovelace&gt; (" in sheet.read_text(encoding="utf-8")
    sheet.unlink()
    assert prefcal("report", "toy-1", "--scenario", TOY)[0] == 0
    assert "1 comparison by Ada &lt;Lovelace&gt; (" in sheet.read_text(encoding="utf-8")


def test_experiments_of_somebody_s_own_plant_are_never_lost(prefcal, monkeypatch):
    start(prefcal, monkeypatch, "")
    assert len(state_of("toy-1").finished) == 2


@pytest.mark.usefixtures("rig_file")
def test_the_record_of_a_rig_is_never_lost(prefcal, monkeypatch, tmp_path):
    # As if the rig were one of ours: its records are not simulations all the same.
    built_in = "prefcal_app.cli.choices.is_built_in"
    monkeypatch.setattr(built_in, lambda source: source == "own.py:oven")
    (tmp_path / "run.csv").write_text("time [h],level [m]\n0,1\n1,2\n2,2\n")
    for typed, kept in (("", []), ("run.csv\n", ["toy-1"])):
        monkeypatch.setattr("sys.stdin", io.StringIO(typed))
        code, out, err = prefcal("calibrate", "own.py:oven", "--terminal", "--n-max", "4")
        assert code == 0, err
        assert names(prefcal) == kept, out + err


def test_an_empty_study_that_is_open_elsewhere_is_left_alone(prefcal, monkeypatch, ours, tmp_path):
    held = []

    def hold(*args):
        code = (
            "import sqlite3, sys\nc = sqlite3.connect(sys.argv[1])\n"
            "c.execute('BEGIN')\nc.execute('SELECT * FROM event').fetchall()\n"
            "print(1, flush=True)\nsys.stdin.read()"
        )
        words = [sys.executable, "-c", code, str(study_path("toy-1"))]
        held.append(subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE))
        held[0].stdout.read(1)

    monkeypatch.setattr("prefcal_app.cli.calibrate.converse", hold)
    start(prefcal, monkeypatch, "")
    assert names(prefcal) == ["toy-1"]
    held[0].communicate()


def test_a_study_that_was_removed_while_it_was_open_is_saved_elsewhere_and_told(prefcal, monkeypatch, ours):
    def lose(*args):
        converse(*args)
        study_path("toy-1").unlink()

    monkeypatch.setattr("prefcal_app.cli.calibrate.converse", lose)
    code, _, err = start(prefcal, monkeypatch, "l\n")
    assert code == 2
    assert "toy-1.prefcal was moved, renamed, removed or replaced while it was open" in err
    assert "answer is saved. Resume" not in err
    assert names(prefcal) == ["toy-1-rescued1"]
    assert len(state_of("toy-1-rescued1").answers) == 1


def test_a_file_in_the_place_of_an_unanswered_study_is_left_alone(prefcal, monkeypatch, ours):
    def replace_file(*args):
        study_path("toy-1").unlink()
        study_path("toy-1").write_text("precious")

    monkeypatch.setattr("prefcal_app.cli.calibrate.converse", replace_file)
    start(prefcal, monkeypatch, "")
    assert study_path("toy-1").read_text() == "precious"


def test_a_command_whose_name_another_one_takes_goes_on_to_the_next(prefcal, monkeypatch, ours):
    def taken(path):
        if path == study_path("toy-1"):
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text("another command's")
        return []

    monkeypatch.setattr("prefcal_app.cli.choices.left_beside", taken)
    _, _, err = start(prefcal, monkeypatch, "l\n")
    assert "Study toy-2 started" in err
    assert study_path("toy-1").read_text() == "another command's"


def test_a_study_is_removed_after_a_question(prefcal, monkeypatch, tmp_path):
    for name in ("one", "two"):
        assert prefcal("calibrate", TOY, *SYNTHETIC, "--study", name)[0] == 0
    code, _, err = prefcal("studies", "rm", "one")
    assert (code, names(prefcal)) == (2, ["one", "two"])
    assert "add --yes" in err
    code, out, _ = prefcal("studies", "rm", "one", "nosuch", "--yes")
    assert (code, out, names(prefcal)) == (2, "", ["one", "two"])
    monkeypatch.setattr("sys.stdin.isatty", lambda: True, raising=False)
    asked = []
    for typed, left in (("n", ["one", "two"]), ("y", ["two"])):
        monkeypatch.setattr("builtins.input", lambda words, t=typed: asked.append(words) or t)
        code, _, err = prefcal("studies", "rm", "one")
        assert (code, names(prefcal)) == (int(typed == "n"), left), err
    assert "4 experiments, 3 answers) for good? [y/N]" in asked[0]
    assert prefcal("studies", "rm", "two", "--yes")[1] == "Removed: two\n"
    assert (tmp_path / "prefcal-two" / "report.html").exists()


def test_a_study_is_renamed(prefcal, tmp_path):
    for name in ("one", "two"):
        assert prefcal("calibrate", TOY, *SYNTHETIC, "--study", name)[0] == 0
    code, _, err = prefcal("studies", "rename", "one", "two")
    assert (code, names(prefcal)) == (2, ["one", "two"])
    assert "there is a study 'two' already" in err
    assert prefcal("studies", "rename", "one", "three")[0] == 0
    assert names(prefcal) == ["three", "two"]
    assert prefcal("studies", "verify", "three")[0] == 0
    assert prefcal("studies", "rename", "three", str(tmp_path / "here.prefcal"))[0] == 0
    assert prefcal("studies", "show", str(tmp_path / "here.prefcal"))[0] == 0


def test_the_list_breaks_no_word_at_80_columns(prefcal, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    long = "overtaking-of-a-truck-on-monday-afternoon"
    for name in ("one", long):
        assert prefcal("calibrate", TOY, *SYNTHETIC, "--study", name)[0] == 0
    _, out, _ = prefcal("studies", "list")
    started = json.loads(prefcal("studies", "list", "--json")[1])[0]["begun"][:10]
    for words in ("experiments", "started", f"{long} ", started, "4 of 4", "all compared"):
        assert words in out
    assert "…" not in out
    (row,) = (line for line in out.splitlines() if line.split()[:1] == ["one"])
    assert "toy_scenario.py:toy" in row
