"""The parameters of an FMU are varied."""

import numpy as np
import pytest

from prefcal_env import Knob
from prefcal_env.errors import ScenarioError
from prefcal_scenarios.verification import replay, verify
from prefcal_scenarios.worlds.fmu import fmu_scenario
from worlds.fmu.building import built


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
