"""The campaign that measures cutting: its figures by hand, and a short study."""

import importlib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


@pytest.fixture
def campaign(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "benchmarks" / "campaigns")
    return importlib.import_module("cutting")


def row(threshold, hours, worth, stops=0, wrong=0, place="tank"):
    return {"place": place, "taste": "weights", "seed": 0, "threshold": threshold,
            "experiments": 2, "hours": hours, "worth": [1.0, worth], "stops": stops,
            "wrong": wrong, "saved": 0.0}  # fmt: skip


def test_the_tables_hold_time_saved_wrong_stops_and_the_ratio_of_worth(campaign):
    rows = [row(0.0, [10, 10], 10.0), row(0.01, [10, 5], 40.0, 4, 1),
            row(0.0, [2, 2], 10.0, place="servo"),
            row(0.01, [2, 1], 10.0, 1, 0, "servo")]  # fmt: skip
    text = "\n".join(campaign.tables(rows))
    assert "| never | tank | 1 | 0 of 2 | 0 |  | 10 |  |" in text
    assert "| 0.01 | tank | 1 | 4 of 2 | 1 (25.0 %) | 25 % | 40 | 4.00 |" in text
    assert "| 0.01 | all | 2 | 5 of 4 | 1 (20.0 %) | 25 % | 20 | 2.00 |" in text


def test_a_study_without_cutting_runs_every_experiment_to_its_end(campaign):
    made = campaign.study("tank", "weights", 1, 0.0, 12)
    assert made["stops"] == made["wrong"] == made["saved"] == 0
    assert len(made["hours"]) == len(made["worth"]) == 12
    assert max(made["hours"]) == 600.0  # an unsafe run ends earlier
    assert made["worth"] == sorted(made["worth"])  # the person makes no mistakes
