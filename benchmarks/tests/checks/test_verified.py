"""`prefcal verify` counts the failures that other code counts, and a difference would be found."""

import ast
import importlib
import sys
from pathlib import Path

import numpy as np
import pytest

CHECKS = Path(__file__).parents[2] / "checks"
LOOP = "oscillatory"  # nearly half of its plants fail


@pytest.fixture(scope="module")
def check():
    sys.path.insert(0, str(CHECKS))
    yield importlib.import_module("verified")
    sys.path.remove(str(CHECKS))


@pytest.fixture(scope="module")
def fragile(check):
    return check.compared(LOOP, check.PROCESSES[LOOP], "fragile", 40, 1000)


def test_the_other_code_imports_nothing_of_prefcal():
    tree = ast.parse((CHECKS / "monte_carlo.py").read_text(encoding="utf-8"))
    names = {
        name.split(".")[0]
        for node in ast.walk(tree)
        for name in (
            [node.module or ""]
            if isinstance(node, ast.ImportFrom)
            else [each.name for each in node.names]
            if isinstance(node, ast.Import)
            else []
        )
    }
    assert names == {"dataclasses", "numpy", "scipy"}


def test_a_fragile_tuning_fails_as_often_in_the_other_code_plant_by_plant(check, fragile):
    assert 0 < fragile.failed < fragile.runs
    assert fragile.differ <= 1
    assert fragile.above == 0
    assert check.report([fragile])[1] == []


def test_a_simulation_that_forgets_what_varies_would_be_found(check, fragile, monkeypatch):
    right = check.failures
    monkeypatch.setattr(check, "failures", lambda *given: right(*given[:-1], 0 * given[-1] + check.NOMINAL))
    nominal = check.compared(LOOP, check.PROCESSES[LOOP], "fragile", 40, 1000)
    assert (nominal.failed, nominal.differ, nominal.others) == (fragile.failed, fragile.failed, 0)
    said = [f"{LOOP}, fragile: the shares differ", f"{LOOP}, fragile: verdicts differ"]
    assert check.report([nominal])[1] == said


def test_verdicts_that_differ_and_bounds_that_do_not_hold_are_said(check, fragile):
    rows = [check.Compared("a", 299, 0, 4, 0, 3000, (0.01,))]
    assert check.report(rows)[1] == ["a: verdicts differ"]
    low = [check.Compared("b", 299, 0, 0, 10, 3000, (0.001,))] * 3
    assert check.report(low)[1] == ["3 of 3 bounds are below the share of the other code"]


def test_verifications_of_a_loop_add_up(check):
    once, again = (check.Compared("a", 100, n, 1, 30, 3000, (bound,)) for n, bound in ((1, 0.005), (2, 0.02)))
    (sum_,) = check.together([once, again])
    assert (sum_.runs, sum_.failed, sum_.differ, sum_.others, sum_.drawn) == (200, 3, 2, 60, 6000)
    assert (sum_.bounds, sum_.above) == ((0.005, 0.02), 1)


def test_what_a_file_has_is_not_compared_again(check, monkeypatch, tmp_path):
    asked = []

    def compared(name, _, kind, runs, others, seed):
        asked.append((name, kind, seed))
        return check.Compared(f"{name}, {kind}", runs, 0, 0, 0, others, (0.03,))

    monkeypatch.setattr(check, "compared", compared)
    first = list(check._rows(["lag"], 9, 90, 1, tmp_path / "rows.jsonl"))
    assert list(check._rows(["lag"], 9, 90, 2, tmp_path / "rows.jsonl"))[:2] == first
    assert asked == [("lag", kind, seed) for seed in (0, 1) for kind in ("sound", "fragile")]


def test_a_run_of_the_other_code_is_that_of_small_steps(check):
    """A lag of 7 s, dead times that are no whole samples, a slow actuator, a sensor that shows too much."""
    code = sys.modules["monte_carlo"]
    experiment = code.StepAndLoad(1.0, 3.0, 0.5, 20.0, 0.7, -50.0, 50.0)
    pid = code.PID(0.6, 7.0, 0.5, 0.8, 10.0)
    late, factors = (
        code.TransferFunction((2.0,), (7.0, 1.0), 1.3, 0.4),
        np.array([[1.0, 1.0, 1.0, 0.9, 0.01]]),
    )
    y, _ = code.simulated(late, experiment, pid, factors)
    assert 3.0 < y.max() < 4.5  # the step, and then the load
    law, given = code._Law(pid, experiment, np.array([0.5]), np.array([1.02])), []
    x, acting, past = 1.0, 0.5, [1.0]
    for k in range(len(y)):
        assert y[k, 0] == pytest.approx(past[-401] if k else 1.0, abs=2e-3)
        given.append((700 * k, law.move(y[k] + 0.02)[0]))
        for now in range(700 * k, 700 * (k + 1)):  # in ms
            reaching = next((u for at, u in reversed(given) if at + 1300 <= now), 0.5)
            load = 0.5 if k >= 29 else 0.0  # 29 samples last 20.3 s
            x += 1e-3 * (2.0 * (acting + load) - x) / 7.0
            acting += 1e-3 * (reaching - acting) / 0.9
            past.append(x)
