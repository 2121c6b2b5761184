"""All named closed loops: what every one of them satisfies."""

import numpy as np
import pytest

from prefcal_env.errors import KnobError, ScenarioError
from prefcal_env.experiments.experiment import End
from prefcal_scenarios.cases.loops import LOOPS, loop, named
from prefcal_scenarios.cases.loops.family import nominal
from prefcal_scenarios.runs import INTERRUPTED, outcome
from prefcal_scenarios.scenario import with_ranges
from support.varied import random

every = pytest.mark.parametrize("name", LOOPS)


@every
def test_a_loop_starts_in_a_steady_state_that_its_inputs_can_hold(name):
    rng = np.random.default_rng(0)
    for vary in (nominal, *(random(rng) for _ in range(20))):
        made = LOOPS[name](vary)
        x0, u0 = made.task.x0, made.task.u0
        dx = made.plant.f(x0, u0, made.task.disturbance(0.0))
        assert dx == pytest.approx(np.zeros(len(x0)), abs=1e-9)
        assert all(c.low <= u <= c.high for c, u in zip(made.plant.inputs, u0, strict=True))


@every
def test_theta_outside_the_space_is_refused_until_the_range_is_widened(name):
    scenario = named(name)
    theta = scenario.space.decode(np.full(len(scenario.space), 0.5))
    theta[0] = scenario.space.knobs[0].high * 1.1
    with pytest.raises(KnobError, match=scenario.space.names[0]):
        scenario.run(theta)
    first = scenario.space.knobs[0]
    wide = type(first)(first.name, first.low, 2 * first.high, first.unit, scale=first.scale)
    space = type(scenario.space)([wide, *scenario.space.knobs[1:]])
    assert with_ranges(scenario, space).run(theta).theta[0] == theta[0]


def test_an_unknown_name_is_refused_with_the_nearest_one():
    with pytest.raises(ScenarioError, match="Did you mean 'oscillatory'"):
        named("oscilatory")


def test_a_theta_without_a_controller_is_a_failed_run(monkeypatch):
    def refuse(*matrices):
        raise np.linalg.LinAlgError("no finite solution")

    monkeypatch.setattr(loop, "solve_discrete_are", refuse)
    scenario = named("cart-pole")
    run = scenario.run(scenario.space.decode(np.full(len(scenario.space), 0.5)))
    assert run.end is End.FAILED
    assert len(run.t) == 0
    assert outcome(scenario, run)[INTERRUPTED] == 1.0
