"""The short file with an own plant, as it stands in the documentation."""

import runpy
from pathlib import Path

import numpy as np

FILE = Path(__file__).parents[1] / "docs" / "own_plant.py"


def test_a_motor_with_a_pid_is_tuned_by_preferences():
    own = runpy.run_path(str(FILE), run_name="__main__")
    best = own["best"]
    assert best.x[:, 0].max() < 1.03
    assert best.x[-1, 0] > 0.98
    later = best.x[best.t >= 1.0, 0]
    assert np.all(np.abs(later - 1) < 0.03)
    assert len(own["found"].samples) == 30


def test_it_is_short():
    lines = [line for line in FILE.read_text(encoding="utf-8").splitlines() if line.strip()]
    assert len(lines) <= 75
