"""What every session of tests has, for the benchmark: checked shapes, and small samples to ask for."""

from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from support.session import check_shapes

check_shapes({"prefcal_bench": Path(__file__).parents[2]})


@pytest.fixture
def small_samples(monkeypatch):
    """Random experiments of closed loops and others: 64 show what is usual, 128 are the pool."""
    sample = import_module("prefcal_bench.people.sample")  # the function has the same name
    for name, count in (("_USUAL", 64), ("_QUICK_POOL", 128), ("_SLOW_POOL", 128)):
        monkeypatch.setattr(sample, name, count)
    # With so few, hardly any taste is usual.
    monkeypatch.setattr("prefcal_bench.people.named._USUAL", (0.0, np.inf))
    monkeypatch.setattr(import_module("prefcal_bench.problems.problem"), "_READ", {})
