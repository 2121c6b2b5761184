"""The campaign that measures twins: its twins, its figures by hand, and that it resumes."""

import importlib
from pathlib import Path

import numpy as np
import pytest

from prefcal_scenarios import load, simulator

ROOT = Path(__file__).parents[3]


@pytest.fixture
def twin(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "benchmarks" / "campaigns")
    return importlib.import_module("twin")


def row(agent, worth, twin="none", plant=1, cost=2.0):
    return {
        "plant": plant,
        "taste": "weights",
        "seed": 0,
        "agent": agent,
        "twin": twin,
        "worth": [1.0] + [worth] * 19,
        "cost": [9.0] + [cost] * 19,
        "lowest": [1.9],
    }


def test_a_twin_with_wrong_signs_turns_two_kpis_and_leaves_the_others(twin):
    plant, theta = load("loop-300"), np.array([])
    right, turned = simulator(plant, seed=1), twin.twin_of(300, "signs")
    for z in np.random.default_rng(1).random((30, len(plant.space))):
        theta = plant.space.decode(plant.space.snap(z))
        before, after = right(theta), turned(theta)
        assert after["overshoot"] == before["overshoot"]
        if np.isfinite(before["error"]):
            one = before["error"] * after["error"]
    theta = plant.space.decode(np.full(len(plant.space), 0.5))
    assert right(theta)["error"] * turned(theta)["error"] == pytest.approx(one)


def test_the_tables_hold_worth_ratio_and_the_share_near_the_lowest_cost(twin):
    rows = [
        row("GLISp", 10.0),
        row("corrected", 40.0, "3"),
        row("GLISp", 10.0, plant=2, cost=9.0),
        row("corrected", 9.0, "3", plant=2, cost=2.0),
    ]
    text = "\n".join(twin.tables(rows))
    assert "| 3 | corrected | 2 | 1 | 19 | 19 | 19 | 19 |" in text  # √(40 · 9)
    assert "| 3 | corrected | 1.00 | 1.90 | 1.90 | 1.90 | 1.90 | 1 of 2 |" in text
    assert "| 3 | corrected | 0 % | 100 % | 100 % | 100 % | 100 % |" in text
    assert "| none | GLISp | 0 % | 50 % | 50 % | 50 % | 50 % |" in text
