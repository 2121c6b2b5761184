"""All closed loops: what every one of them satisfies, and the random ones."""

import numpy as np
import pytest

from prefcal_env.errors import KnobError, ScenarioError
from prefcal_env.experiments.end import End
from prefcal_scenarios.cases.loops import LOOPS, controllers, loop, named, rough_model
from prefcal_scenarios.cases.loops.kinds.parts import nominal, random
from prefcal_scenarios.kpis import INTERRUPTED, outcome
from prefcal_scenarios.scenario import with_ranges

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


def test_a_seed_gives_one_random_loop_and_seeds_differ():
    first, again, other = loop(3), loop(3), loop(4)
    theta = first.space.decode(np.full(len(first.space), 0.5))
    assert first.name == again.name != other.name
    assert first.run(theta) == again.run(theta)


def test_a_theta_without_a_controller_is_a_failed_run(monkeypatch):
    def refuse(*matrices):
        raise np.linalg.LinAlgError("no finite solution")

    monkeypatch.setattr(controllers, "solve_discrete_are", refuse)
    scenario = named("cart-pole")
    run = scenario.run(scenario.space.decode(np.full(len(scenario.space), 0.5)))
    assert run.end is End.FAILED
    assert len(run.t) == 0
    assert outcome(scenario, run)[INTERRUPTED] == 1.0


def test_a_rough_model_without_an_error_is_the_loop_itself():
    for seed in (300, 301):
        ours, model = loop(seed), rough_model(seed, 0.0)
        theta = ours.space.decode(np.full(len(ours.space), 0.5))
        assert model.run(theta).kpis == ours.run(theta).kpis


def test_a_rough_model_is_the_more_off_the_larger_its_error():
    ours, theta = loop(300), loop(300).space.decode(np.full(6, 0.5))
    error = ours.run(theta).kpis["error"]
    off = [abs(rough_model(300, e).run(theta).kpis["error"] - error) for e in (0.01, 0.03, 0.1)]
    assert 0 < off[0] < off[1] < off[2] < 0.3 * error
    with pytest.raises(ScenarioError, match="error of a model must be 0 or more, got -1"):
        rough_model(300, -1)
