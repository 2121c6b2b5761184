"""Closed loops whose plants, sensors and actuators vary: what is promised of every one of them."""

import numpy as np
import pytest

from prefcal_env.envs.varied_loop import at_rest
from prefcal_env.sources.varied import draw
from prefcal_scenarios import load


def found(scenario):
    return scenario.source.varied()


def varied(name, values):
    """The loop of a scenario with other values."""
    return found(load(name)).at(values).function.func.__self__


def middle(scenario):
    return scenario.space.decode(scenario.space.snap(np.full(len(scenario.space), 0.5)))


def assert_it_starts_at_rest_where_the_study_does(name):
    loop, subject = load(name).run.function.__self__, found(load(name))
    first = loop.plant.measured[0]
    for k in range(6):
        values = draw(subject.factors, 3, k)
        made = varied(name, values)
        shift = values.get("start", 0.0) * (loop.target.start[0] - loop.task.x0[first])
        if at_rest(made.plant, made.task.x0, made.task.u0, made.task.disturbance(0.0)):
            assert made.task.x0[first] == pytest.approx(loop.task.x0[first] + shift, abs=1e-6)
        else:  # some four tanks have no rest at these levels
            assert name.endswith("quadruple-tank")


def assert_without_a_variation_the_run_is_that_of_the_study(name):
    scenario = load(name)
    theta = middle(scenario)
    assert found(scenario).at({})(theta, seed=4) == scenario.run(theta, seed=4)
