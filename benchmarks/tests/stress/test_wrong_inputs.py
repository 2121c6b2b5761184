"""Random wrong inputs are refused in one clear line; and the campaign that says so could fail.

The same in full: python benchmarks/stress/wrong_inputs.py
"""

import importlib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
FEW = {
    "options": 20,
    "files": 2,
    "records": 16,
    "tables": 20,
    "requests": 40,
    "taste": 30,
    "exports": 60,
    "steps": 20,
}
"""Number of inputs of each door; the others start many processes, or make a study first."""


@pytest.fixture
def campaign(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "benchmarks" / "stress")
    return importlib.import_module("wrong_inputs")


@pytest.mark.slow
@pytest.mark.parametrize("door", FEW)
def test_wrong_inputs_are_refused_in_one_clear_line(campaign, tmp_path, door):
    for number in range(FEW[door]):
        folder = tmp_path / str(number)
        folder.mkdir()
        wrong = campaign.wrong_input(door, number, seed=5)
        assert campaign.faults(wrong, folder) == [], wrong.about


def wrong(campaign, call, **more):
    return campaign.Wrong(call, "a test", **{"named": ("the knob",), **more})


def raised(folder):
    raise ValueError("nobody handles this")


def left(campaign):
    def call(folder):
        (folder / "half.json").touch()
        return campaign.Said(2, "the knob")

    return call


def said(campaign, *words):
    return lambda folder: campaign.Said(*words)


@pytest.mark.parametrize(
    ("call", "fault"),
    [
        (lambda c: raised, "raised: "),
        (lambda c: said(c, 0, "the knob"), "exit code 0"),
        (lambda c: said(c, 2, "a\nthe knob"), "2 lines"),
        (lambda c: said(c, 2, ""), "0 lines"),
        (lambda c: said(c, 2, "the knob " * 100), "a line of 900 characters"),
        (lambda c: said(c, 2, "something is wrong"), "none of ['the knob'] is named"),
        (lambda c: said(c, 1, "Traceback (most recent call last): the knob"), "a traceback"),
        (left, "left behind: ['here/half.json']"),
    ],
)
def test_what_is_not_right_is_told(campaign, tmp_path, call, fault):
    assert campaign.faults(wrong(campaign, call(campaign)), tmp_path)[0].startswith(fault)


def test_one_clear_line_is_right(campaign, tmp_path):
    assert campaign.faults(wrong(campaign, said(campaign, 2, "The knob is none")), tmp_path) == []


def test_an_input_follows_from_door_number_and_seed(campaign):
    about = [
        campaign.wrong_input("options", number, seed).about
        for number, seed in ((1, 0), (1, 0), (2, 0), (1, 1))
    ]
    assert about[0] == about[1]
    assert len({*about}) == 3
