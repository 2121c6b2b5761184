"""FMUs and maneuvers are varied, too; what cannot be is said."""

import numpy as np
import pytest

from prefcal_env import Knob, KnobSpace, Maneuvers, recorded
from prefcal_env.errors import ScenarioError
from prefcal_scenarios import KPI, Scenario
from prefcal_scenarios.described.fmu_scenario import fmu_scenario
from prefcal_scenarios.verification import replay, verify
from support.fmus import built


def test_kpis_that_a_scenario_does_not_state_are_found():
    def run(theta, seed=0, lag=2.0):
        t = np.linspace(0.0, 20.0, 201)
        return recorded(theta, t, {"y": 1 - np.exp(-t * theta[0] / lag)}, reference={"y": 1.0}, kpis=None)

    found = verify(
        Scenario("lag", "Lag", KnobSpace([Knob("gain", 0.0, 9.0)]), run), np.array([2.0]), 4, jobs=1
    )
    assert found.kpis
    assert all({kpi.name for kpi in found.kpis} <= set(run.kpis) for run in found.runs)


@pytest.fixture(scope="module")
def tank(tmp_path_factory):
    pytest.importorskip("fmpy")
    pytest.importorskip("pythonfmu")
    return built(tmp_path_factory.mktemp("fmus"), "Tank")


def test_parameters_of_an_fmu_that_are_no_knobs_vary(tank):
    scenario = fmu_scenario(tank, knobs=[Knob("K_p", 0.1, 10.0)], show=["level"], reference={"level": 2})
    theta = np.array([2.0])
    found = verify(scenario, theta, 6, jobs=2)
    assert [(f.name, f.low, f.high) for f in found.factors] == [("T_i", 9.0, 11.0)]
    assert len({tuple(run.kpis.values()) for run in found.runs}) == 6
    assert found.runs == verify(scenario, theta, 6, jobs=1).runs
    assert "no margins" in found.tuning.margins
    assert found.kpis
    assert {kpi.name for kpi in found.kpis} <= set(found.tuning.nominal.kpis)
    nominal, low = (replay(scenario, theta, run) for run in (found.tuning.nominal, found.alone[0]))
    assert nominal.kpis == scenario.run(theta).kpis
    assert np.array_equal(low.theta, theta)
    other = fmu_scenario(
        tank, knobs=[Knob("K_p", 0.1, 10.0), Knob("T_i", 1.0, 60.0)], show=["level"], reference={"level": 2}
    )
    assert low.kpis == other.run(np.array([2.0, 9.0])).kpis


def test_an_fmu_whose_parameters_are_all_knobs_says_so(tank):
    scenario = fmu_scenario(tank, knobs=[Knob("K_p", 0.1, 10.0), Knob("T_i", 1.0, 60.0)], show=["level"])
    with pytest.raises(ScenarioError, match="no other real parameters"):
        verify(scenario, np.array([2.0, 10.0]))


def step(theta, seed=0, mass=1.0, load=3.0):
    made = recorded(theta, [0.0, 1.0], {"y": [0.0, 1.0]})
    return made.with_kpis({"weight": mass * theta[0], "pull": load})


def heavy(theta, seed=0, mass=2.0):
    return step(theta, seed, mass=mass, load=0.0)


def test_all_maneuvers_meet_the_same_variation():
    runs = Maneuvers({"light": step, "heavy": heavy})
    kpis = (KPI("weight", "weight", better="lower"), KPI("pull", "pull", better="lower"))
    space = KnobSpace([Knob("gain", 0.0, 10.0)])
    scenario = Scenario("both", "Both", space, runs, kpis=kpis)
    found = verify(scenario, np.array([2.0]), 20, jobs=1)
    assert [(f.name, f.nominal) for f in found.factors] == [("mass", 1.0), ("load", 3.0)]
    for run in found.runs:
        mass = run.values["mass"]
        assert run.kpis["weight (light)"] == pytest.approx(2 * mass)
        assert run.kpis["weight (heavy)"] == pytest.approx(4 * mass)
        assert run.kpis["pull"] == run.values["load"]
    assert found.tuning.nominal.kpis == scenario.run(np.array([2.0])).kpis
