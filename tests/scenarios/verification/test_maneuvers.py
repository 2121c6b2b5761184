"""All maneuvers are varied alike, and KPIs that a scenario does not state are found."""

import numpy as np
import pytest

from prefcal_env import Knob, KnobSpace, Maneuvers, recorded
from prefcal_scenarios import KPI, Scenario
from prefcal_scenarios.verification import verify


def test_kpis_that_a_scenario_does_not_state_are_found():
    def run(theta, seed=0, lag=2.0):
        t = np.linspace(0.0, 20.0, 201)
        return recorded(theta, t, {"y": 1 - np.exp(-t * theta[0] / lag)}, reference={"y": 1.0}, kpis=None)

    found = verify(
        Scenario("lag", "Lag", KnobSpace([Knob("gain", 0.0, 9.0)]), run), np.array([2.0]), 4, jobs=1
    )
    assert found.kpis
    assert all({kpi.name for kpi in found.kpis} <= set(run.kpis) for run in found.runs)


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
