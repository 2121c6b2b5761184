from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from prefcal_bench.cells.cell import Cell
from prefcal_bench.cells.roster import entry
from prefcal_bench.cells.run import run_cell
from prefcal_bench.problems import problem
from prefcal_bench.problems.functions import FUNCTIONS

OWN = Path(__file__).parents[1] / "bench_support" / "agents.py"
LOOP = f"{OWN.with_name('loop.py')}:SCENARIO"


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


@pytest.mark.usefixtures("small_samples")
def test_a_cell_on_a_loop_records_worth_kpis_and_comparisons():
    told = cell(problem=LOOP, calibrator="weights", seed=3, n_max=8)
    result = run_cell(told)
    assert not result.failure
    assert result.gaps is None
    assert result.visited is None
    assert len(result.worth) == len(result.kpis) == len(result.questions) == 8
    assert result.kpi_names == ("error", "effort", "margin", "score")
    where = problem(LOOP)
    for theta, row in zip(result.thetas, result.kpis, strict=True):
        run = where.outcome(np.array(theta)).experiment
        assert row == tuple(run.kpis[name] for name in result.kpi_names)
    # It compares each θ with the winner so far, and the worth is that of the winner.
    person, winner = where.person("weights", 3), 0
    for k, (new, old, verdict) in enumerate(result.comparisons, start=1):
        assert (new, old) == (k, winner)
        winner = new if verdict == -1 else old
        found = where.outcome(np.array(result.thetas[winner]))
        assert result.worth[k] == person.worth(found)
    assert result.questions == tuple(range(8))
    assert np.all(np.diff(result.worth) >= 0)  # the answers are the referee's
    assert run_cell(told) == result
    assert run_cell(cell(problem=LOOP, calibrator="weights", seed=4, n_max=8)) != result


@pytest.mark.usefixtures("small_samples")
@pytest.mark.parametrize("taste", ["priorities", "hidden-noisy20", "rising", "limits"])
def test_our_agent_runs_on_a_loop_with_any_taste_twice_the_same(taste):
    asked = cell("GLISp", LOOP, taste, n_max=5)
    result = run_cell(asked)
    assert not result.failure
    assert len(result.worth) == 5
    assert min(result.worth) >= 1.0
    assert len(result.comparisons) == result.questions[-1] >= 4
    assert run_cell(asked) == result


@pytest.mark.usefixtures("small_samples")
def test_on_a_loop_a_value_based_agent_is_told_the_taste_s_cost():
    result = run_cell(cell("Sees", LOOP, "weights", seed=3, n_max=8))
    where = problem(LOOP)
    person = where.person("weights", 3)
    costs = [person.cost(where.outcome(np.array(theta))) for theta in result.thetas]
    assert result.best == result.thetas[int(np.argmin(costs))]
    assert result.comparisons == ()
    assert result.questions == (0,) * 8
    assert result.worth == run_cell(cell(problem=LOOP, calibrator="weights", seed=3, n_max=8)).worth


@pytest.mark.usefixtures("small_samples")
def test_where_no_cost_has_the_order_a_value_based_agent_fails():
    assert run_cell(cell("Sees", LOOP, "priorities")).failure


@pytest.mark.usefixtures("small_samples")
@pytest.mark.parametrize(("taste", "told"), [("weights", True), ("hidden", False)])
def test_agents_are_told_kpis_unless_the_taste_is_for_hidden_ones(monkeypatch, taste, told):
    heard = []

    class Hears(type(entry(f"{OWN}:Own").make(problem(LOOP).space, 1, 2, 0))):
        def tell(self, query, answer):
            heard.append(answer)
            super().tell(query, answer.preference)

    def make(space, n_init, n_max, seed):
        return Hears(space, n_init=n_init, n_max=n_max, seed=seed)

    made = SimpleNamespace(missing="", by_value=False, make=make, simulates=False)
    monkeypatch.setattr("prefcal_bench.cells.run.entry", lambda name: made)
    result = run_cell(cell("RandomSearch", LOOP, taste, seed=1))
    assert not result.failure
    names = {name for answer in heard for side in answer.outcomes if side for name in side}
    used = {"error", "effort", "margin"}
    assert (used <= names) == told
    assert all(len(answer.outcomes) == 2 for answer in heard)
    assert heard[0].outcomes[1] is None  # nothing to compare the first one with


def test_no_theta_of_a_scenario_is_run_twice(monkeypatch):
    ran = []

    def run(theta):
        ran.append(tuple(theta))
        return camel.run(theta)

    camel = problem("camel")
    watched = replace(camel, run=run)
    monkeypatch.setattr("prefcal_bench.cells.run.problem", lambda name: watched)
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
        ("Quits", "GeneratorExit: enough"),
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
    [({"problem": "nowhere"}, "no problem is called"), ({"calibrator": "x"}, "must be one of")],
)
def test_a_cell_that_cannot_be_is_a_failed_result(change, words):
    assert words in run_cell(cell(**change)).failure


def test_a_worker_of_another_version_refuses():
    known = cell("RandomSearch")
    assert not run_cell(known, key=known.key).failure
    assert "another version" in run_cell(known, key="0" * 64).failure
