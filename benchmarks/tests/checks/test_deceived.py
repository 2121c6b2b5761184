"""What deceives a verification is found by it, or stands in its table of what was not varied."""

import numpy as np
import pytest
from scipy import signal

from prefcal_env import ClosedLoop, PlantEnv
from prefcal_env.experiments.experiment import Channel
from prefcal_env.plants.plant import Plant
from prefcal_scenarios.described.pid_scenario import pid_scenario
from prefcal_scenarios.verification import verify
from prefcal_scenarios.verification.nominal import margins_at

VALVE = Channel("valve", "%", 0.0, 100.0)


def pid(num=(0.8,), den=(20.0, 1.0), **more):
    return pid_scenario(Plant.of((num, den), inputs=[VALVE], **more))


def in_samples():
    return pid_scenario(Plant.of(signal.dlti([0.04], [1, -0.95, 0, 0], dt=1.0)))


def of_one_step():
    loop = pid(delay=6.0).source.varied().loop
    return ClosedLoop(PlantEnv(loop.plant, loop.task), loop.controller, lambda e: {"left": float(e.y[-1, 0])})


@pytest.mark.parametrize(
    ("hidden", "make", "told"),
    [
        ("dead time in the sensor that nobody stated", pid, "dead time"),
        ("dead time in the states of a sampled model", in_samples, "poles at 0"),
        ("a valve with a rate", lambda: pid(delay=6.0), "rate of the actuators"),
        ("another set point, since KPIs know one step only", of_one_step, "start, size and sign"),
    ],
)
def test_what_is_hidden_is_told_as_not_varied(hidden, make, told):
    made = make()
    varied = getattr(made, "source", made).varied()
    assert any(told in what for what, _ in varied.left_out), hidden


@pytest.mark.parametrize(
    ("where", "late"), [("delay", {"delay": 6.0}), ("output_delay", {"output_delay": 6.0})]
)
def test_dead_time_is_found_wherever_it_stands(where, late):
    scenario = pid(**late)
    theta = fastest(scenario, 0.5)
    found = verify(scenario, theta, 8, ranges=only({"dead time": (0.9, 1.1)}), jobs=1)  # of 6 s
    assert found.tuning.nominal.kpis["settling_time"] < np.inf
    assert found.tuning.margins.delay < 0.9 * 6
    assert len(found.failed) > 4, where


def test_a_slow_actuator_is_found():
    scenario, theta = pid(delay=1.0), np.array([22.5, 8.0, 0.0, 1.0])  # a PI with little delay margin
    found = verify(scenario, theta, 6, ranges=only({"lag of the actuators": (1.0, 1.3)}), jobs=1)
    assert len(found.failed) > 4
    assert not verify(scenario, theta, 1, ranges=only({"lag of the actuators": (0.0, 0.01)}), jobs=1).failed


def test_a_resonance_in_the_model_costs_its_margins():
    scenario = pid((0.8,), np.polymul([20.0, 1.0], [4.0, 0.1, 1.0]))
    theta = np.array(scenario.references["MIGO"])
    slow, fast = (margins_at(scenario.source.varied(), theta * [k, 1, 1, 1]) for k in (1.0, 4.0))
    assert slow.M_s < 2.1
    assert fast.gain == 1.0, "it is unstable"


def only(ranges):
    return {"parameter": 0.0, "dead time": 0.0, "sensor": 0.0, "actuator": 0.0, "task": 0.0, **ranges}


def fastest(scenario, left):
    """The robust tuning with a larger gain, so that only a share of the delay margin is `left`."""
    theta, known = np.array(scenario.references["MIGO"]), scenario.source.varied()
    all_of_it = margins_at(known, theta).delay
    gains = theta * np.array([[k, 1, 1, 1] for k in np.geomspace(1, 20, 80)])
    return next(each for each in gains if margins_at(known, each).delay < left * all_of_it)
