"""The generator of rough loops: what it promises of every one."""

import pickle

import numpy as np
import pytest

from prefcal_app.report.write import resting
from prefcal_bench.loops import loop, rough, rough_loop
from prefcal_env.errors import ScenarioError
from prefcal_env.experiments.experiment import End
from prefcal_scenarios.catalog import load
from support.varied_loops import (
    assert_it_starts_at_rest_where_the_study_does,
    assert_without_a_variation_the_run_is_that_of_the_study,
)

pytestmark = pytest.mark.slow  # each loop takes half a second to draw
SEEDS = (0, 3, 7, 14)
every = pytest.mark.parametrize("seed", SEEDS)


def drawn(space, count, seed=1):
    points = np.random.default_rng(seed).random((count, len(space)))
    return [space.decode(z) for z in space.snap_all(space.scaled(points))]


@every
def test_some_theta_fail_some_settle_and_there_are_plateaus(seed):
    made = rough.accepted(seed)
    runs = [made.run(theta) for theta in drawn(made.space, 200)]
    safe = [run for run in runs if run.end is End.TIME_UP]
    assert 0.03 <= 1 - len(safe) / len(runs) <= 0.45
    assert any(np.isfinite(run.kpis["settling_time"]) for run in safe)
    assert 0.4 <= np.mean([run.kpis["alarm"] == 0 for run in safe]) <= 0.8


@every
def test_there_are_integer_knobs_and_rough_actuators(seed):
    made = rough.accepted(seed)
    assert any(knob.integer for knob in made.space) or "T_s" in made.space.names
    assert all(one.stiction > 0 or one.backlash > 0 for one in made.actuators)
    assert len(made.actuators) == len(made.plant.inputs)
    assert all(knob.about for knob in made.scenario().space)


def test_all_kinds_of_roughness_occur():
    many = [rough.accepted(seed) for seed in range(12)]
    assert {bool(one.target.steps) for one in many} == {True, False}
    assert {bool(one.resolution) for one in many} == {True, False}
    assert {"stages" in one.space.names for one in many} == {True, False}
    for part in ("stiction", "backlash", "resolution"):
        assert {getattr(a, part) > 0 for one in many for a in one.actuators} == {True, False}
    assert len({one.title.partition(",")[0] for one in many}) > 4


def test_a_seed_gives_one_loop_by_its_name_and_it_can_be_sent_to_a_worker():
    scenario, again = load("rough-3"), rough_loop(3)
    theta = drawn(scenario.space, 1)[0]
    assert scenario.name == again.name == "rough-3"
    assert scenario.run(theta, seed=1) == again.run(theta, seed=1)
    assert pickle.loads(pickle.dumps(scenario.run))(theta, seed=1) == scenario.run(theta, seed=1)
    assert scenario.kpis != loop(3).kpis


@pytest.mark.parametrize("seed", [-1, 1.5, True, "3"])
@pytest.mark.unchecked
def test_a_seed_that_is_no_number_is_refused(seed):
    with pytest.raises(ScenarioError, match="seed of a loop must be an integer, 0 or more"):
        rough_loop(seed)


def test_a_loop_of_which_no_draw_is_worth_tuning_is_refused(monkeypatch):
    monkeypatch.setattr(rough, "is_worth_tuning", lambda loop: False)
    monkeypatch.setattr(rough, "_TRIES", 2)
    with pytest.raises(ScenarioError, match="none of 2 draws of the rough loop 123456"):
        rough.accepted(123456)


varied = pytest.mark.parametrize("name", ["rough-900", "rough-903"])


@varied
def test_a_varied_loop_starts_at_rest_where_the_study_does(name):
    assert_it_starts_at_rest_where_the_study_does(name)


@varied
def test_without_a_variation_the_run_is_that_of_the_study(name):
    assert_without_a_variation_the_run_is_that_of_the_study(name)


def test_a_loop_says_where_its_inputs_rest():
    made = load("rough-900")
    assert resting(made) == pytest.approx(made.run.function.__self__.task.u0)
