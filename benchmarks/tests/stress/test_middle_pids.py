"""The tunings in the middle of a PID's ranges are measured on plants of every kind."""

import sys
from pathlib import Path

import numpy as np
import pytest


@pytest.fixture
def middle_pids(monkeypatch):
    monkeypatch.syspath_prepend(Path(__file__).parents[2] / "stress")
    import middle_pids

    return middle_pids


def test_every_plant_of_the_batch_can_be_made(middle_pids):
    names = [name for name, _ in middle_pids.plants()]
    assert len(set(names)) == len(names) == 50


def test_a_row_has_what_the_middle_tuning_does_and_shares_of_random_ones(middle_pids, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["middle_pids.py", "--random", "4", "--only", "swing 0.4"])
    middle_pids.main()
    row, *ends = capsys.readouterr().out.splitlines()[2:]
    _, name, overshoot, M_s, settling, stable, settle, _ = (cell.strip() for cell in row.split("|"))
    assert name == "swing 0.4"
    assert float(overshoot) < 5.0
    assert float(M_s) < 1.6
    assert np.isfinite(float(settling))
    assert float(settle) <= float(stable) == 100.0
    assert ends[0] == f"overshoot [%]: {overshoot} to {overshoot}, median {overshoot}"
