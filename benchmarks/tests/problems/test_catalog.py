from pathlib import Path

import numpy as np
import pytest

from prefcal_bench.people import TASTES, VERSION
from prefcal_bench.problems import CALIBRATORS, GUIDELINES, NOISES, PROBLEMS, problem
from prefcal_bench.problems.functions import FUNCTIONS
from prefcal_env.errors import ScenarioError, SettingsError
from prefcal_scenarios.catalog import load
from prefcal_scenarios.names import CLOSED_LOOPS

OWN = Path(__file__).parents[1] / "bench_support" / "loop.py"


def test_closed_loops_come_first_then_test_functions_and_the_paper_s_cases():
    assert list(PROBLEMS) == [*CLOSED_LOOPS, *FUNCTIONS, "cstr", GUIDELINES, "overtake"]
    assert len(set(CALIBRATORS)) == len(CALIBRATORS)
    assert set(CALIBRATORS) == {"perfect", "lexicographic", *NOISES, *TASTES}


@pytest.mark.parametrize("name", ["servo", "building", "quadruple-tank", "loop-7"])
def test_a_closed_loop_is_judged_by_tastes_alone(name):
    where = problem(name)
    assert (where.name, where.space) == (name, load(name).space)
    assert where.answering == TASTES
    assert where.calibrators == {}
    assert not where.has_cost
    assert where.kpi_names == tuple(kpi.name for kpi in load(name).kpis)
    assert where.version.endswith(f", tastes {VERSION}")
    assert problem(name) is where  # made once


@pytest.mark.parametrize(
    ("name", "tastes", "own"),
    [
        ("camel", (), ("perfect", *NOISES)),
        (GUIDELINES, (), ("lexicographic",)),
        ("cstr", TASTES, ("perfect", *NOISES)),
        ("overtake", TASTES, ("lexicographic", *NOISES)),
    ],
)
def test_tastes_also_judge_the_paper_s_cases(name, tastes, own):
    assert problem(name).answering == (*own, *tastes)


def test_a_random_loop_is_another_one_with_another_seed():
    assert problem("loop-4").version != problem("loop-5").version


def test_a_scenario_of_one_s_own_is_judged_by_tastes():
    where = problem(f"{OWN}:SCENARIO")
    assert where.name == f"{OWN}:SCENARIO"
    assert where.answering == TASTES
    found = where.outcome(np.array([0.5, 0.5, 0.5]))
    assert found.cost is None
    assert found.kpis["error"] == found.experiment.kpis["error"]
    assert where.kpi_names == ("error", "effort", "margin", "score")


def test_a_problem_of_one_s_own_keeps_its_calibrators_and_the_file_is_part_of_its_version():
    where = problem(f"{OWN}:PROBLEM")
    assert where.name == f"{OWN}:PROBLEM"
    assert where.answering == ("perfect", *NOISES)
    assert where.version.startswith("7, ")
    assert where.gap(where.outcome(np.array([0.3, 0.3, 0.3]))) == pytest.approx(0.0)


def test_a_changed_file_is_loaded_again(tmp_path):
    path = tmp_path / "own.py"
    path.write_text(OWN.read_text())
    names = [f"{path}:SCENARIO", f"{path}:PROBLEM"]
    before = [problem(name) for name in names]
    assert [problem(name) for name in names] == before
    path.write_text(OWN.read_text().replace('"effort": 1.0 +', '"effort": 2.0 +'))
    after = [problem(name) for name in names]
    assert all(a.version != b.version for a, b in zip(after, before, strict=True))
    theta = np.array([0.5, 0.5, 0.5])
    new, old = (each[0].outcome(theta).kpis["effort"] for each in (after, before))
    assert new == pytest.approx(old + 1.0)
    path.write_text(OWN.read_text() + "# a remark\n")
    remarked = [problem(name) for name in names]
    assert remarked[0].version == before[0].version  # it gives the same KPIs
    assert remarked[1].version != before[1].version  # nobody can know


@pytest.mark.parametrize(
    ("name", "error", "words"),
    [
        ("Camel", SettingsError, "no problem is called 'Camel'. Did you mean 'camel'"),
        ("loop-x", SettingsError, "no problem is called 'loop-x'"),
        ("", SettingsError, "Expected lag, .*overtake, loop-SEED, or path/to/own.py:NAME"),
        ("absent.py:X", ScenarioError, r"no file 'absent\.py' to load a problem from"),
        (f"{OWN.parent}/absent.py:X", ScenarioError, "no file"),
        (f"{OWN}:NUMBER", SettingsError, "must name a Scenario or a Problem, got 3"),
        (f"{OWN}:absent", SettingsError, "must name a Scenario or a Problem, got None"),
        (f"{OWN}:AIMLESS", SettingsError, "has no KPI with a direction, which tastes need"),
    ],
)
def test_what_is_no_problem_says_so(name, error, words):
    with pytest.raises(error, match=words):
        problem(name)


LOUD = """
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
    path.write_text(LOUD)
    return path


def test_what_it_prints_goes_to_standard_error(own, capsys):
    assert "weights" in problem(f"{own}:loud").answering
    printed = capsys.readouterr()
    assert printed.out == ""
    assert "an experiment" in printed.err


def test_experiments_that_differ_when_repeated_are_refused(own):
    with pytest.raises(ScenarioError, match="repeated experiments of one θ have other KPIs"):
        problem(f"{own}:drifting")
