"""Offset-free MPC: no offset where the model is wrong, less noise than was measured."""

from dataclasses import replace

import numpy as np
import pytest

from prefcal_env.envs.cstr import TARGET, cstr_task
from prefcal_env.envs.plant_env import PlantEnv
from prefcal_env.errors import SettingsError
from prefcal_env.experiments.control import Measurement
from prefcal_env.experiments.experiment import Channel
from prefcal_env.experiments.rollout import rollout
from prefcal_env.mpc import DisturbanceEstimator, EstimatingMPC, EstimatorSettings, LinearMPC, MPCSettings
from prefcal_env.plants.bicycle import Bicycle
from prefcal_env.plants.cstr import CSTR, FEED, CSTRParams
from prefcal_env.plants.function_plant import FunctionPlant

MPC = MPCSettings(
    T_s=0.31, N_p=26, N_u=9, Q_y=[[0, 0], [0, 1]], Q_du=[[10**-1.79]], du_min=[-10.0], du_max=[10.0]
)
OFFSET_FREE = EstimatorSettings(noise=(0.3, 0.03), process=(0.1, 0.01), drift=(0.1, 0.01), on_outputs=(0, 1))
REACTORS = {
    "faster reaction": CSTRParams(k_0=1.05 * 3.49e7),
    "better cooling": CSTRParams(US_V=1.05 * 150),
    "worse cooling": CSTRParams(US_V=0.95 * 150),
}
THETA = np.zeros(1)  # for the record alone


def at_rest(controller, params, horizon=48.0):
    """The run of 48 h that does not stop where it has settled."""
    plant = CSTR(params)
    task = replace(cstr_task(plant), settled=lambda step: False, horizon=horizon)
    return rollout(PlantEnv(plant, task), controller, THETA)


@pytest.mark.parametrize("name", REACTORS)
def test_where_the_model_is_wrong_it_has_no_offset_and_the_plain_mpc_has_one(name):
    plain = at_rest(LinearMPC(CSTR(), MPC), REACTORS[name])
    free = at_rest(EstimatingMPC(CSTR(), MPC, OFFSET_FREE), REACTORS[name])
    assert abs(plain.x[-1, 1] - TARGET) > 0.05
    assert free.x[-1, 1] == pytest.approx(TARGET, abs=0.005)
    assert free.solved.all()


def test_where_the_model_is_right_it_decides_as_the_plain_mpc():
    plain, free = (
        at_rest(c, CSTRParams()) for c in (LinearMPC(CSTR(), MPC), EstimatingMPC(CSTR(), MPC, OFFSET_FREE))
    )
    np.testing.assert_allclose(free.u_control, plain.u_control, atol=1e-3)


def test_output_limits_hold_for_the_outputs_as_they_are_not_as_the_model_has_them():
    limited = replace(MPC, y_min=[-np.inf, 2.5], y_max=[np.inf, np.inf], Q_eps=1e6)
    free = at_rest(EstimatingMPC(CSTR(), limited, OFFSET_FREE), REACTORS["faster reaction"])
    plain = at_rest(LinearMPC(CSTR(), limited), REACTORS["faster reaction"])
    assert free.x[-1, 1] == pytest.approx(2.5, abs=0.005)
    assert plain.x[-1, 1] < 2.49


def noisy_run(controller, noise, steps=150, seed=0):
    """True and measured states at the sampling instants, each (steps, 2), and the estimates."""
    rng, plant = np.random.default_rng(seed), CSTR()
    task = cstr_task(plant)
    x, u = task.x0, task.u0
    true, measured, estimated = [], [], []
    for k in range(steps):
        y = x + noise * rng.standard_normal(2)
        u = controller.move(Measurement(k * MPC.T_s, y, u, FEED, task.reference(0.0))).u
        outputs = controller.estimator.estimate.mean
        true.append(x), measured.append(y), estimated.append(outputs[:2] + outputs[2:])
        x = plant.hold(x, u, FEED, np.array([MPC.T_s]))[0]
    return np.array(true), np.array(measured), np.array(estimated)


def test_with_noise_the_estimated_outputs_are_better_than_the_measured_ones():
    noise = np.array([0.3, 0.03])
    x, y, estimated = noisy_run(EstimatingMPC(CSTR(), MPC, OFFSET_FREE), noise)
    of_estimate = np.sqrt(np.mean((estimated - x) ** 2, axis=0))
    assert np.all(of_estimate < 0.6 * np.sqrt(np.mean((y - x) ** 2, axis=0)))
    assert x[-1, 1] == pytest.approx(TARGET, abs=0.1)


def measurement(x, d=FEED, u=(299.0,)):
    return Measurement(0.0, np.array(x), np.array(u), np.array(d), np.array([320.0, 8.0]))


def test_previewed_disturbances_are_kept_and_each_row_gets_the_estimated_ones():
    estimator = DisturbanceEstimator(CSTR(), OFFSET_FREE, 0.3)
    preview = np.array([FEED, FEED + 1, FEED + 2])
    seen = estimator.see(measurement([320.0, 8.0], preview))
    assert seen.d.shape == (3, 4)
    np.testing.assert_array_equal(seen.d[:, :2], preview)
    assert np.all(seen.d[:, 2:] == seen.d[0, 2:])


def test_without_disturbances_it_estimates_the_state_alone():
    settings = EstimatorSettings(noise=(0.3, 0.03), process=(1.0, 0.1))
    seen = DisturbanceEstimator(CSTR(), settings, 0.3).see(measurement([320.0, 8.0]))
    np.testing.assert_array_equal(seen.d, FEED)
    np.testing.assert_allclose(seen.x, [320.0, 8.0])


def test_an_estimate_that_is_not_finite_is_given_up_for_what_is_measured():
    escaping = FunctionPlant(
        lambda x, u, d: x**2 + u, states=[Channel("x")], inputs=[Channel("u", low=-1.0, high=1.0)]
    )
    settings = EstimatorSettings(noise=(0.1,), process=(0.1,), drift=(0.1,), on_outputs=(0,))
    estimator = DisturbanceEstimator(escaping, settings, 1.0)
    estimator.see(Measurement(0.0, np.array([10.0]), np.zeros(1), np.zeros(0), np.zeros(1)))
    with np.errstate(all="ignore"):
        seen = estimator.see(Measurement(1.0, np.array([0.5]), np.zeros(1), np.zeros(0), np.zeros(1)))
    np.testing.assert_array_equal(seen.x, [0.5])
    np.testing.assert_array_equal(seen.d, [0.0])


def test_a_position_that_is_off_cannot_be_told_from_one_that_is_not():
    settings = EstimatorSettings(noise=(0.1,) * 3, process=(0.1,) * 3, drift=(0.1,), on_outputs=(1,))
    estimator = DisturbanceEstimator(Bicycle(), settings, 0.1)
    with pytest.raises(SettingsError, match="cannot be distinguished from the state of 'bicycle'"):
        estimator.see(measurement([0.0, 0.0, 0.0], d=(), u=(14.0, 0.0)))


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"noise": (0.3,)}, "noise must hold 2 numbers"),
        ({"noise": (0.3, 0.0)}, "noise must be finite and above 0"),
        ({"process": (1.0, -1.0)}, "process must be finite and at least 0"),
        ({"drift": (1.0,)}, "drift must hold 2 numbers"),
        ({"start": (1.0, 1.0, 1.0)}, "start must hold 2 numbers"),
        ({"on_outputs": (0, 2)}, "on_outputs must be different indices below 2"),
        ({"on_inputs": (0,)}, "3 disturbances are too many for 2 outputs"),
    ],
)
def test_impossible_settings_are_refused(changes, match):
    with pytest.raises(SettingsError, match=match):
        EstimatingMPC(CSTR(), MPC, replace(OFFSET_FREE, **changes))
