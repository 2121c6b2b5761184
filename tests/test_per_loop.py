"""The table of worth by loop: ratios and intervals by hand."""

import importlib
from pathlib import Path

import pandas as pd
import pytest

ROOT = Path(__file__).parents[1]


@pytest.fixture
def per_loop(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "benchmarks" / "campaigns")
    return importlib.import_module("judged.per_loop")


def raw(worths):
    """Return a table as of `prefcal bench`: worth by (agent, loop, seed) at two moments."""
    rows = [
        {"agent": agent, "taste": "weights", "loop": loop, "seed": seed, "after": after,
         "worth": worth if after == 50 else 1.0}
        for (agent, loop, seed), worth in worths.items() for after in (50, 20)
    ]  # fmt: skip
    return pd.DataFrame(rows)


def test_ratios_and_what_is_surely_above_or_below(per_loop):
    worths = {("A", loop, seed): 100.0 for loop in ("x", "y", "z") for seed in range(4)}
    for seed, factor in enumerate((0.9, 1.0, 1.0, 1.1)):
        worths |= {("B", "x", seed): 50.0 * factor, ("B", "y", seed): 300.0 * factor}
        worths["B", "z", seed] = 100.0 * factor**20
    lines = list(per_loop.table(raw(worths), "A", "B"))[2:]
    assert [line.split(" | ")[-1].strip("| ") for line in lines] == ["above", "below", ""]
    # The logarithms differ by 0.696, with a deviation of 0.0822: 3.182 · 0.0822 / √4 = 0.131.
    assert "| x | 4 | 100 | 50 | 2.01 [1.76, 2.28] |" in lines[0]


def test_the_interval_is_that_of_student(per_loop):
    low, high = per_loop.ratio(pd.Series([0.0, 1.0, 2.0]).to_numpy())
    assert (low, high) == pytest.approx((0.2267, 32.59), rel=1e-3)  # e^(1 ± 4.303 / √3)
