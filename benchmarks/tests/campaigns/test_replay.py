"""Whole studies of people who are not of the learner's form: nothing that the page says is untrue.

The same in full: python benchmarks/campaigns/replay.py
"""

import importlib
from pathlib import Path

import numpy as np
import pytest

from prefcal_app.simulating import Simulator

ROOT = Path(__file__).parents[3]


@pytest.fixture
def script(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "benchmarks" / "campaigns")
    return importlib.import_module("replay")


def test_the_first_noticeable_difference_decides(script):
    who = script.InOrder({"time": 0.5, "peak": 1.0})
    assert who.prefers({"time": 1.0, "peak": 9.0}, {"time": 2.0, "peak": 0.0}) == 1
    assert who.prefers({"time": 1.0, "peak": 9.0}, {"time": 1.4, "peak": 0.0}) == -1
    assert who.prefers({"time": 1.0, "peak": 0.5}, {"time": 1.4, "peak": 0.0}) == 0
    assert who.prefers({"time": np.inf, "peak": 0.0}, {"time": np.inf, "peak": 2.0}) == 1


def test_limits_come_before_the_sum_of_all(script):
    who = script.WithinLimits({"peak": 1.0}, {"time": 2.0, "peak": 1.0}, 0.2)
    assert who.prefers({"time": 9.0, "peak": 1.0}, {"time": 0.0, "peak": 1.1}) == 1
    assert who.prefers({"time": 2.0, "peak": 0.5}, {"time": 1.0, "peak": 0.5}) == -1
    assert who.prefers({"time": 1.1, "peak": 0.5}, {"time": 1.0, "peak": 0.5}) == 0
    assert who.prefers({"time": 1.0, "peak": 0.5}, {"time": np.inf, "peak": 0.5}) == 1


def test_a_sentence_that_the_table_contradicts_is_found(script):
    def row(title, better):
        return {"title": title, "better": better, "size": 1.0}

    rows = [row("peak", "left"), row("peak error", "right")]
    check = script._against_table
    assert not list(check("Left has lower peak, but higher peak error (...).", rows, "left"))
    assert not list(check("Right has higher peak (...).", rows, "right"))
    assert len(list(check("Left has lower peak error (...).", rows, "left"))) == 1
    assert len(list(check("Left has lower peak, but higher peak error.", rows, "right"))) == 2


@pytest.mark.parametrize("loop", ["servo", "pid"])
@pytest.mark.parametrize("kind", [0, 1])
def test_pages_of_whole_studies_say_nothing_untrue(script, loop, kind):
    scenario = script.scenario_of(loop)
    with Simulator(scenario, jobs=0) as simulator:
        for seed in range(2):
            who = script.person(script.PEOPLE[kind], scenario, seed)
            found = script.replay(scenario, who, seed, simulator, 100)
            assert found.untrue == []
            assert 10 <= found.questions <= 13
