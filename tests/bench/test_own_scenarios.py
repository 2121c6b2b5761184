"""A user's own scenario as a problem: what it prints, and that its experiments are repeatable."""

import pytest

from prefcal_bench.problems import problem
from prefcal_env.errors import ScenarioError

FILE = """
from dataclasses import replace
from itertools import count

from prefcal_scenarios import load

_lag, _calls = load("lag"), count()


def _loud(theta, seed=0):
    print("an experiment")
    return _lag.run(theta, seed)


def _drifting(theta, seed=0):
    return _lag.run(theta, next(_calls))


loud, drifting = replace(_lag, run=_loud), replace(_lag, run=_drifting)
"""


@pytest.fixture
def own(tmp_path):
    path = tmp_path / "own.py"
    path.write_text(FILE)
    return path


def test_what_it_prints_goes_to_standard_error(own, capsys):
    assert "weights" in problem(f"{own}:loud").answering
    printed = capsys.readouterr()
    assert printed.out == ""
    assert "an experiment" in printed.err


def test_experiments_that_differ_when_repeated_are_refused(own):
    with pytest.raises(ScenarioError, match="repeated experiments of one θ have other KPIs"):
        problem(f"{own}:drifting")
