"""A plant with disturbances of outputs and inputs, and the same as further states."""

import pickle

import numpy as np
import pytest

from prefcal_env.errors import SettingsError
from prefcal_env.plants.bicycle import Bicycle
from prefcal_env.plants.cstr import CSTR, FEED
from prefcal_env.plants.plant import Disturbed


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
    np.testing.assert_array_equal(
        disturbed.hold(x, u, w, times), plant.hold(x, penalized, np.zeros(0), times)
    )
    np.testing.assert_array_equal(
        disturbed.jacobians(x, u, w).B, plant.jacobians(x, penalized, np.zeros(0)).B
    )


@pytest.mark.parametrize("chosen", [{"on_outputs": (2,)}, {"on_outputs": (0, 0)}, {"on_inputs": (-1,)}])
def test_indices_that_are_none_are_refused(chosen):
    with pytest.raises(SettingsError, match="must be different indices below"):
        Disturbed(CSTR(), **chosen)


def test_a_copy_in_another_process_has_equations_of_its_own():
    disturbed = Disturbed(CSTR(), on_outputs=(1,))
    before = disturbed.equations
    copied = pickle.loads(pickle.dumps(disturbed))
    assert "equations" not in vars(copied)
    np.testing.assert_array_equal(copied.equations.on_outputs, before.on_outputs)
