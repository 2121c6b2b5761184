"""The overtaking in several scenes at once, and its controller with an estimator."""

import pickle
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from prefcal_env.envs.overtake import Car, Course, Obstacle, OvertakeOptions
from prefcal_env.errors import KnobError, ScenarioError, SettingsError
from prefcal_env.experiments.experiment import End
from prefcal_env.experiments.rollout import rollout
from prefcal_env.plants.bicycle import Bicycle
from prefcal_env.plants.function_plant import FunctionPlant
from prefcal_env.preferences.answer import Preference
from prefcal_scenarios.cases.overtake import overtake, overtake_variants
from prefcal_scenarios.cases.overtake.controller import ESTIMATOR, STEERING_LIMITS, controller
from prefcal_scenarios.cases.overtake.kpis import HIGHER_IS_BETTER
from prefcal_scenarios.cases.overtake.robust import VARIANTS
from prefcal_scenarios.scenario import load

PAPER = overtake.references["paper, preferences"]
SLOW = np.array([0.3, 0.5, 12.0, -1.0, 1.0])


@cache
def robust(seed=0):
    return load("overtake-robust").run(PAPER, seed)


def test_an_experiment_is_made_of_all_variants_the_papers_first():
    e = robust()
    assert len(e.runs) == len(VARIANTS)
    np.testing.assert_array_equal(e.x, e.runs[0].x)
    assert e.end is End.TIME_UP


def test_the_kpis_are_the_worst_of_the_runs():
    e = robust()
    assert e.kpis.keys() == {kpi.name for kpi in load("overtake-robust").kpis}
    for name, value in e.kpis.items():
        values = [run.kpis[name] for run in e.runs]
        assert value == (min(values) if name in HIGHER_IS_BETTER else max(values))


def test_the_papers_optimum_does_well_in_every_variant():
    e = robust()
    assert e.kpis["collision"] == 0
    assert e.kpis["unsolved"] == 0
    distances = dict(zip(VARIANTS, (run.kpis["lateral_distance"] for run in e.runs), strict=True))
    assert distances.pop("braking obstacle") > 2.1  # 0.0873 rad/s is slow beside who brakes
    assert min(distances.values()) > 2.9


def test_the_seed_decides_the_noise_and_nothing_else():
    same, other = load("overtake-robust").run(PAPER, 0), robust(1)
    assert same == robust()
    differs = [a != b for a, b in zip(robust().runs, other.runs, strict=True)]
    assert differs == [name == "measurement noise" for name in VARIANTS]


def test_without_noise_and_mismatch_the_estimator_changes_next_to_nothing():
    nominal, plain = robust().runs[0], overtake.run(PAPER)
    np.testing.assert_allclose(nominal.u_control, plain.u_control, atol=1e-4)


def test_a_collision_in_one_variant_is_one_of_the_experiment():
    # It stands across the left lane's way, where nobody looks.
    blocked = OvertakeOptions(traffic=(Obstacle(), Obstacle(x=70.0, y=4.0, speed=5.0)))
    scenario = overtake_variants({"nominal": OvertakeOptions(), "blocked": blocked})
    e = scenario.run(PAPER)
    assert [r.end for r in e.runs] == [End.TIME_UP, End.UNSAFE]
    assert e.end is End.UNSAFE
    assert e.kpis["collision"] == 1
    assert e.duration == e.runs[0].duration


def test_the_calibrator_judges_the_worst_variant():
    blocked = OvertakeOptions(traffic=(Obstacle(), Obstacle(x=70.0, y=4.0, speed=5.0)))
    crashed = overtake_variants({"nominal": OvertakeOptions(), "blocked": blocked}).run(PAPER)
    calibrator = overtake.calibrators["fast-processor"]()
    assert calibrator.prefer(crashed, robust()) is Preference.INCUMBENT


def test_it_can_be_pickled_for_other_processes():
    scenario = pickle.loads(pickle.dumps(load("overtake-robust").run))
    assert scenario(SLOW, 3) == load("overtake-robust").run(SLOW, 3)


def test_the_settings_tell_of_the_estimator():
    settings = load("overtake-robust").settings(PAPER)
    assert settings["estimator"]["on_inputs"] == (1,)
    assert "lane keeping" in settings


def test_no_variant_and_a_strange_theta_are_refused():
    with pytest.raises(ScenarioError, match="one or more variants"):
        overtake_variants({})
    with pytest.raises(KnobError):
        load("overtake-robust").run(np.zeros(5))


def final_offset(estimator, bias=np.pi / 180):
    """|y_f| at the end of a free road with a steering that is off by 1° [m]."""
    bicycle = Bicycle()
    plant = FunctionPlant(
        lambda x, u, d: bicycle.f(x, u + np.array([0.0, bias]), d),
        states=bicycle.states, inputs=bicycle.inputs,
    )  # fmt: skip
    options = OvertakeOptions(car=Car(plant), traffic=(Obstacle(x=500.0),))
    e = rollout(Course(options), controller(PAPER, estimator=estimator), PAPER)
    return abs(e.x[-1, 1])


def test_a_steering_that_is_off_leaves_an_offset_that_the_estimator_removes():
    assert final_offset(None) > 0.05
    assert final_offset(ESTIMATOR) < 0.005


def test_with_noise_the_estimator_calms_the_steering():
    """With the limit per step: per second, steering is so slow that noise hardly moves it."""
    noisy, per_step = OvertakeOptions(noise=(0.1, 0.05, 0.01)), STEERING_LIMITS["per step"]
    moves = [
        np.mean([
            np.diff(
                rollout(
                    Course(noisy), controller(PAPER, per_step, e), PAPER, seed=seed
                ).u_control[:, 1]
            ).std()
            for seed in range(3)
        ])
        for e in (None, ESTIMATOR)
    ]  # fmt: skip
    assert moves[1] < 0.95 * moves[0]


def test_disturbances_of_positions_are_refused_since_they_cannot_be_told():
    positions = replace(ESTIMATOR, on_inputs=(), on_outputs=(1,))
    with pytest.raises(SettingsError, match="cannot be distinguished"):
        rollout(Course(), controller(PAPER, estimator=positions), PAPER)
