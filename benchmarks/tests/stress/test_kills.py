"""The campaign that kills prefcal tells what is lost; it would be worth nothing if it could not fail.

The same in full: python benchmarks/stress/kills.py
"""

import importlib
import json
import random
from hashlib import sha256
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]


@pytest.fixture
def kills(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "benchmarks" / "stress")
    return importlib.import_module("kills")


def test_a_study_that_vanished_is_lost(kills, tmp_path):
    assert kills.lost(tmp_path / "no.prefcal", 0, 0) == ([], 0, False)
    (wrong,), _, _ = kills.lost(tmp_path / "no.prefcal", 3, 0)
    assert wrong == "0 steps acknowledged after 3, the study is gone"
    (wrong,), _, _ = kills.lost(tmp_path / "no.prefcal", 0, 2)
    assert wrong == "2 steps acknowledged after 0, the study is gone"


def test_steps_are_compared_since_the_last_kill(kills, tmp_path, monkeypatch):
    path = tmp_path / "one.prefcal"
    path.touch()
    monkeypatch.setattr(kills, "verify", lambda study: ())
    monkeypatch.setattr(kills, "steps_in", lambda study: (5, False))
    assert kills.lost(path, 3, 1) == ([], 5, False)  # one was recorded, and the kill came before its answer
    assert kills.lost(path, 5, 1)[0] == ["1 steps acknowledged after 5, 0 more are recorded"]


def test_a_study_that_cannot_be_read_is_told(kills, tmp_path):
    path = tmp_path / "one.prefcal"
    path.write_bytes(b"nothing")
    (wrong,), _, _ = kills.lost(path, 0, 0)
    assert wrong.startswith("the study cannot be read: ")


def test_a_command_that_refuses_was_not_killed(kills, tmp_path, monkeypatch):
    monkeypatch.setitem(kills.KINDS, "glisp", ("no-such-scenario",))
    steps, ended, (wrong,) = kills.kill_one(
        tmp_path, "glisp", tmp_path / "one.prefcal", random.Random(0), kill=False
    )
    assert (steps, ended) == (0, False)
    assert wrong.startswith("it ended with ")
    assert "no-such-scenario" in wrong


@pytest.mark.parametrize("set_already", [False, True])
def test_a_mark_changes_something(kills, set_already):
    visitor, marks = kills.Visitor.__new__(kills.Visitor), ["unsafe", "good enough"] if set_already else []
    side = {"marks": marks}
    question = {"id": 7, "repeat": False, "left": side, "right": side}
    visitor.get = lambda name: {"phase": "question", "question": question, "version": 1}
    posts = []
    visitor.post = lambda name, **body: posts.append((name, body))
    dice = random.Random(1)
    for _ in range(60):
        visitor.step(dice)
    marked = [body["on"] for name, body in posts if name == "mark"]
    assert marked
    assert set(marked) == {not set_already}


BEST = '{"experiment": 2, "theta": {"a": 1.0}}'
SHEET = "Acceptance sheet <th>experiment 2</th> <th>unit</th> all kept"
DIGEST = sha256(BEST.encode()).hexdigest()
AGREEING = {
    "report/best.json": BEST,
    "report/report.html": "<style>(9)</style><th>best (2)</th>",
    "report/acceptance.html": SHEET,
    "api/now": '{"over": {"best": {"number": 2}}}',
    "api/verification": json.dumps({"said": {"best": DIGEST, "statement": "all kept"}}),
}


@pytest.mark.parametrize(
    ("name", "text", "what"),
    [
        ("report/best.json", BEST.replace("1.0", "1.5"), "best.json, verification"),
        ("report/report.html", "<th>best (9)</th>", "report"),
        ("report/acceptance.html", SHEET.replace("2", "1"), "sheet"),
        ("report/acceptance.html", SHEET.replace("kept", ""), "verification on the sheet"),
        ("api/now", '{"over": null}', "page"),
        ("api/verification", '{"said": {"best": "0", "statement": "all kept"}}', "verification"),
    ],
)
def test_what_is_not_of_the_best_experiment_is_told(kills, name, text, what):
    visitor, held = kills.Visitor.__new__(kills.Visitor), AGREEING
    visitor.text = lambda name: held[name]
    assert kills.compare_once(2, [1.0], visitor) == []
    held = AGREEING | {name: text}
    assert kills.compare_once(2, [1.0], visitor) == [f"{what}: not of experiment 2 of the study, [1.0]"]
