"""Runs whose right values are known are measured rightly by every door, and a wrong value is named."""

import importlib
from dataclasses import replace
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]


@pytest.fixture
def trips(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "benchmarks" / "campaigns")
    return importlib.import_module("round_trips")


def test_every_kind_is_right_by_every_door(trips, monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["round_trips.py", "--count", "12"])
    assert trips.main() == 0
    assert "12 runs by four doors: 0 values wrong" in capsys.readouterr().out
    assert {trips.RoundTrip.of(seed).kind for seed in range(12)} == set(trips.KINDS)


def test_a_wrong_value_is_named(trips, monkeypatch, tmp_path):
    case = replace(trips.RoundTrip.of(0), kind="step", moment=5.0, noise=0.0, damping=0.4)
    assert list(trips.wrong(case, tmp_path)) == []
    honest = trips.RoundTrip.sampled

    def late(case):
        t, y, r = honest(case)
        return t, y, 0 * r + r[-1]  # as if the set point had been there from the beginning

    monkeypatch.setattr(trips.RoundTrip, "sampled", late)
    said = list(trips.wrong(case, tmp_path))
    assert any("settling time by rig is" in words for words in said)
