from pathlib import Path

import numpy as np
import pytest

from prefcal_scenarios.bench import Cell, run_cell
from prefcal_scenarios.bench.problems import problem
from prefcal_scenarios.cases.functions import FUNCTIONS

OWN = Path(__file__).parents[2] / "support" / "bench_agents.py"


def cell(agent="Own", problem="camel", calibrator="perfect", seed=0, n_init=2, n_max=5):
    name = f"{OWN}:{agent}" if agent[0].isupper() and hasattr_own(agent) else agent
    return Cell(name, problem, calibrator, seed, n_init, n_max)


def hasattr_own(agent):
    return f"class {agent}(" in OWN.read_text() or f"class {agent}:" in OWN.read_text()


def test_a_cell_is_run_by_hand_and_by_the_benchmark_alike():
    result = run_cell(cell())
    camel, rng = FUNCTIONS["camel"], np.random.default_rng(0)
    thetas = [camel.space.decode(rng.random(2)) for _ in range(5)]
    best_so_far = np.minimum.accumulate([camel.gap(theta) for theta in thetas])
    assert not result.failure
    assert np.array_equal(result.thetas, thetas)
    assert np.array_equal(result.gaps, best_so_far)
    assert np.array_equal(result.visited, best_so_far)
    assert result.questions == (0, 1, 2, 3, 4)
    assert result.best == tuple(thetas[int(np.argmin([camel(t) for t in thetas]))])
    assert result.seconds is None
    assert run_cell(cell()) == result
    assert run_cell(cell(seed=1)) != result


def test_a_noisy_calibrator_moves_the_incumbent_and_not_what_was_visited():
    results = [run_cell(cell(calibrator="noisy20", seed=seed, n_max=20)) for seed in range(4)]
    assert any(np.any(np.diff(result.gaps) > 0) for result in results)
    for result in results:
        assert np.all(np.diff(result.visited) <= 0)
        assert np.all(np.array(result.visited) <= result.gaps)


def test_a_value_based_agent_is_told_costs_and_asks_no_questions():
    result = run_cell(cell("Sees"))
    assert result.questions == (0,) * 5
    assert result.gaps == result.visited == run_cell(cell()).gaps


def test_several_questions_to_an_experiment_are_counted():
    assert run_cell(cell("Twice")).questions == (0, 2, 4, 6, 8)


def test_a_problem_without_a_cost_has_no_gaps():
    result = run_cell(cell("RandomSearch", "overtake", "lexicographic", n_max=3))
    assert not result.failure
    assert result.gaps is None
    assert result.visited is None
    assert len(result.thetas) == 3


def test_no_theta_of_a_scenario_is_run_twice(monkeypatch):
    from dataclasses import replace

    ran = []

    def run(theta):
        ran.append(tuple(theta))
        return camel.run(theta)

    camel = problem("camel")
    watched = replace(camel, run=run)
    monkeypatch.setattr("prefcal_scenarios.bench.run.problem", lambda name: watched)
    assert not run_cell(cell(n_max=9)).failure
    assert len(ran) == len(set(ran)) == 9


def test_times_come_from_the_clock_and_change_nothing_else():
    ticks = iter(range(1000))
    timed = run_cell(cell(n_max=9), clock=lambda: float(next(ticks) ** 2))
    starts = 2 * np.arange(9)
    assert timed.seconds == np.median(((starts + 1) ** 2 - starts**2)[-5:])
    assert timed.gaps == run_cell(cell(n_max=9)).gaps


def test_what_an_agent_prints_does_not_reach_standard_output(capsys):
    assert not run_cell(cell("Prints")).failure
    seen = capsys.readouterr()
    assert "so much to say" not in seen.out
    assert "so much to say" in seen.err


@pytest.mark.parametrize(
    ("agent", "words"),
    [
        ("Raises", "OSError: the pump does not answer"),
        ("Exits", "SystemExit: bye"),
        ("Greedy", "ProtocolError: the agent wanted more than 5 experiments"),
        ("Endless", "ProtocolError: the agent is not done after 25 answers"),
        ("Forgetful", "ProtocolError: experiment 0 had another θ before"),
        ("Skips", "ProtocolError: experiment 0 must come next, not 1"),
        ("Outside", "KnobError: theta of knob 'x1' must be in"),
        ("nobody", "SettingsError: no agent is called 'nobody'"),
        ("absent.py:Mine", "ScenarioError: no file 'absent.py'"),
    ],
)
def test_an_agent_that_breaks_the_rules_is_a_failed_result(agent, words):
    result = run_cell(cell(agent, seed=1))
    assert result.failure.startswith(words)
    assert result.thetas == ()


@pytest.mark.parametrize(
    ("change", "words"),
    [({"problem": "nowhere"}, "problem must be one of"), ({"calibrator": "x"}, "must be one of")],
)
def test_a_cell_that_cannot_be_is_a_failed_result(change, words):
    assert words in run_cell(cell(**change)).failure


def test_a_worker_of_another_version_refuses():
    known = cell("RandomSearch")
    assert not run_cell(known, key=known.key).failure
    assert "another version" in run_cell(known, key="0" * 64).failure
