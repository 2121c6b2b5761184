"""KPIs that the benchmark simulates for an agent: as the person's agents are told them."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from prefcal_bench.cells.cell import Cell
from prefcal_bench.cells.run import run_cell
from prefcal_bench.cells.simulation import Simulation
from prefcal_bench.problems import problem
from prefcal_env.errors import SettingsError
from prefcal_scenarios.runs import screened

SUPPORT = Path(__file__).parents[1] / "bench_support"
LOOP = f"{SUPPORT / 'loop.py'}:SCENARIO"
THETA = np.array([0.4, 0.5, 0.6])


@pytest.fixture(autouse=True)
def _nothing_known(monkeypatch):
    monkeypatch.setattr("prefcal_bench.cells.simulation._KNOWN", {})


def watched(name=LOOP):
    """A problem, and the θ that it ran."""
    where, ran = problem(name), []

    def run(theta):
        ran.append(tuple(theta))
        return where.run(theta)

    return replace(where, run=run), ran


def test_kpis_are_those_with_a_direction_all_infinite_if_it_was_interrupted():
    where = problem(LOOP)
    simulate = Simulation(where)
    experiment = where.outcome(THETA).experiment
    assert dict(simulate(THETA)) == {
        "error": experiment.kpis["error"],
        "effort": experiment.kpis["effort"],
        "margin": -experiment.kpis["margin"],
    }
    stopped = simulate(np.array([0.95, 0.5, 0.5]))
    assert dict(stopped) == dict.fromkeys(["error", "effort", "margin"], np.inf)


def test_that_it_was_interrupted_is_known_even_if_all_is_withheld():
    simulate = Simulation(problem(LOOP), frozenset({"error", "effort", "margin"}))
    assert dict(simulate(THETA)) == {"interrupted": 0.0}
    assert dict(simulate(np.array([0.95, 0.5, 0.5]))) == {"interrupted": np.inf}


def test_people_share_simulations_but_not_what_they_are_told():
    where, ran = watched()
    first, second = Simulation(where, frozenset({"error"})), Simulation(where)
    assert "error" not in first(THETA)
    assert dict(second(THETA)) == dict(screened(where.scenario, where.scenario.run(THETA)))
    assert second(-0.0 * THETA) == second(0.0 * THETA)
    assert ran == [tuple(THETA), (0.0, 0.0, 0.0)]
    assert (first.count, second.count) == (1, 2)


def test_memory_stays_small(monkeypatch):
    monkeypatch.setattr("prefcal_bench.cells.simulation._MOST", 3)
    known = sys.modules["prefcal_bench.cells.simulation"]._KNOWN
    simulate, rng = Simulation(problem(LOOP)), np.random.default_rng(0)
    for theta in rng.random((9, 3)):
        assert simulate(theta) == simulate(theta)
    assert [len(kpis) for kpis in known.values()] == [3]
    assert simulate.count == 9
    Simulation(problem("cstr-guidelines"))(np.array([0.25, 26.0, -1.0]))
    assert [name for name, _ in known] == ["cstr-guidelines"]


def test_where_there_are_no_kpis_nothing_can_be_simulated():
    with pytest.raises(SettingsError, match="'camel' have no KPIs"):
        Simulation(problem("camel"))


@pytest.mark.usefixtures("small_samples")
@pytest.mark.parametrize("agent", ["Screening", "EqualWeights"])
def test_results_say_how_many_were_simulated(agent):
    result = run_cell(Cell(agent, LOOP, "weights", 0, 1, 4))
    assert not result.failure
    assert len(result.thetas) == 4
    assert 400 < result.simulated <= 1000
    assert run_cell(Cell("RandomSearch", LOOP, "weights", 0, 1, 4)).simulated is None
    assert run_cell(Cell(agent, LOOP, "weights", 0, 1, 4)) == result


@pytest.mark.usefixtures("small_samples")
def test_a_user_s_own_agent_gets_what_it_asks_for():
    own = f"{SUPPORT / 'agents.py'}:Simulates"
    result = run_cell(Cell(own, LOOP, "weights", 0, 1, 4))
    assert not result.failure
    assert result.simulated == 10
    assert "no KPIs to simulate" in run_cell(Cell(own, "camel", "perfect", 0, 1, 4)).failure
