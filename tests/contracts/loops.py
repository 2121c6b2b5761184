"""What every closed loop promises to the person who compares and to the agent.

A test file imports all of this and defines two fixtures: `name`, and `make`, which makes the loop.
"""

from dataclasses import replace

import numpy as np
import pytest

from prefcal_env.experiments.experiment import End
from prefcal_scenarios.catalog import load
from prefcal_scenarios.names import is_built_in
from prefcal_scenarios.runs import outcome
from prefcal_scenarios.scenario import check_experiment, panels_of


def drawn(space, count, seed=0):
    """Random θ that the knobs' steps allow, physical."""
    return [
        np.array([knob.round(v) for knob, v in zip(space, space.decode(z), strict=True)])
        for z in np.random.default_rng(seed).random((count, len(space)))
    ]


def test_it_is_loaded_by_its_name(name, make):
    assert is_built_in(name)
    assert load(name).name == name
    assert load(name).space == make().space


def test_a_run_is_deterministic_finite_and_ends_for_a_reason(make):
    scenario = make().scenario()
    for theta in drawn(scenario.space, 8):
        run = check_experiment(scenario, theta, scenario.run(theta, seed=1))
        assert run == scenario.run(theta, seed=1)
        assert np.isfinite(run.x).all()
        assert np.isfinite(run.u).all()
        whole = run.duration == pytest.approx(make().task.horizon)
        assert (run.end is End.TIME_UP) if whole else (run.end is End.UNSAFE)
        assert not any(np.isnan(v) for v in (*run.kpis.values(), *outcome(scenario, run).values()))


def test_the_inputs_saturate_and_the_states_are_safe_until_the_end(make):
    made = make()
    low, high = np.array([(c.low, c.high) for c in made.plant.inputs]).T
    floor, ceiling = np.array([(c.low, c.high) for c in made.plant.states]).T
    for theta in drawn(made.space, 8, seed=1):
        run = made.run(theta)
        assert (run.u >= low).all()
        assert (run.u <= high).all()
        within = (run.x >= floor).all(axis=1) & (run.x <= ceiling).all(axis=1)
        assert within[:-1].all()
        assert within[-1] == (run.end is End.TIME_UP)


def test_knobs_and_kpis_say_what_they_are(make):
    scenario = make().scenario()
    assert 3 <= len(scenario.space) <= 8
    assert all(knob.about for knob in scenario.space)
    assert {kpi.better for kpi in scenario.kpis} == {"lower"}
    dimensionless = {kpi.name for kpi in scenario.kpis if not kpi.unit}
    inputs = {c.unit for c in make().plant.inputs}
    assert dimensionless <= ({"switches"} if "" not in inputs else {"effort", "input_noise"})
    run = scenario.run(drawn(scenario.space, 1)[0])
    assert list(run.kpis) == [kpi.name for kpi in scenario.kpis]


def test_the_panels_show_target_output_and_inputs(make):
    made = make()
    run = made.run(drawn(made.space, 1)[0])
    plots = panels_of(made.scenario(), run)
    assert plots[0].channel.name == made.plant.states[made.plant.measured[0]].name
    assert [p.channel.name for p in plots][-len(made.plant.inputs) :] == [c.name for c in made.plant.inputs]
    assert made.channels.y[0].target == made.target.start[0]


def test_the_noise_does_not_depend_on_theta(make):
    made = make()
    noise = made.noise(seed=3)
    assert (noise == made.noise(seed=3)).all()
    assert (noise != made.noise(seed=4)).all()
    assert noise.std(axis=0) == pytest.approx(made.task.noise, rel=0.15)


def test_the_disturbance_acts_and_nothing_before_it_knows(make):
    made = make()
    same = ((made.disturbed_at, made.disturbance.start),)
    calm = replace(made, task=replace(made.task, d=replace(made.disturbance, steps=same)))
    theta = next(t for t in drawn(made.space, 20) if made.run(t).end is End.TIME_UP)
    a, b = made.run(theta), calm.run(theta)
    before = a.t <= made.disturbed_at
    assert (a.x[before] == b.x[before]).all()
    assert np.abs(a.x[len(before) - 1] - b.x[len(before) - 1]).max() > 0
