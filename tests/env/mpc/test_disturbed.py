"""A plant with disturbances of outputs and inputs, and the same as further states."""

import numpy as np
import pytest

from prefcal_env.errors import SettingsError
from prefcal_env.mpc.disturbed import Augmented, Disturbed
from prefcal_env.plants.bicycle import Bicycle
from prefcal_env.plants.cstr import CSTR, FEED
from support.linear_plant import random_plant

H = 1e-6


def differences(function, point):
    columns = [(function(point + H * e) - function(point - H * e)) / (2 * H)
               for e in np.eye(len(point))]  # fmt: skip
    return np.array(columns).T


def test_a_disturbance_of_an_output_is_added_to_it_and_changes_nothing_else():
    plant, x, u = CSTR(), np.array([320.0, 8.0]), np.array([299.0])
    d = np.append(FEED, 0.25)
    disturbed = Disturbed(plant, on_outputs=(1,))
    np.testing.assert_allclose(disturbed.g(x, u, d), [320.0, 8.25])
    np.testing.assert_array_equal(disturbed.f(x, u, d), plant.f(x, u, FEED))
    assert disturbed.disturbances[-1].name == "disturbance of concentration"


def test_a_disturbance_of_an_input_is_a_different_input():
    plant, x, u = Bicycle(), np.array([1.0, 0.5, 0.1]), np.array([14.0, 0.05])
    disturbed, w, times = Disturbed(plant, on_inputs=(1,)), np.array([0.02]), np.array([0.1, 0.2])
    penalized = u + np.array([0.0, 0.02])
    np.testing.assert_array_equal(disturbed.hold(x, u, w, times),
                                  plant.hold(x, penalized, np.zeros(0), times))  # fmt: skip
    np.testing.assert_array_equal(disturbed.jacobians(x, u, w).B,
                                  plant.jacobians(x, penalized, np.zeros(0)).B)  # fmt: skip


def test_augmented_its_jacobians_are_those_of_its_equations():
    rng = np.random.default_rng(3)
    plant = Augmented(Disturbed(random_plant(3), on_outputs=(1,), on_inputs=(0,)))
    x, u, d = rng.normal(size=5), rng.normal(size=2), rng.normal(size=1)
    J = plant.jacobians(x, u, d)
    for found, function, point in (
        (J.A, lambda x: plant.f(x, u, d), x), (J.B, lambda u: plant.f(x, u, d), u),
        (J.C, lambda x: plant.g(x, u, d), x), (J.D, lambda u: plant.g(x, u, d), u),
    ):  # fmt: skip
        np.testing.assert_allclose(found, differences(function, point), atol=1e-7)


def test_augmented_its_disturbances_stay_while_its_state_moves():
    plant = Augmented(Disturbed(Bicycle(), on_outputs=(2,), on_inputs=(0,)))
    x = np.array([0.0, 0.0, 0.0, 0.1, -1.0])
    states = plant.hold(x, np.array([14.0, 0.0]), np.zeros(0), np.array([0.5, 1.0]))
    np.testing.assert_allclose(states, [[6.5, 0, 0, 0.1, -1.0], [13.0, 0, 0, 0.1, -1.0]])
    assert len(plant.states) == 5


@pytest.mark.parametrize("chosen", [{"on_outputs": (2,)}, {"on_outputs": (0, 0)},
                                    {"on_inputs": (-1,)}])  # fmt: skip
def test_indices_that_are_none_are_refused(chosen):
    with pytest.raises(SettingsError, match="must be different indices below"):
        Disturbed(CSTR(), **chosen)
