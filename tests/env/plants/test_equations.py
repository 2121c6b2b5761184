"""Kernels call the equations of every plant: compiled ones, or its Python methods."""

import numba
import numpy as np
import pytest

from prefcal_env.errors import PlantError
from prefcal_env.experiments.control import Measurement
from prefcal_env.experiments.experiment import Channel
from prefcal_env.mpc import LinearMPC, MPCSettings
from prefcal_env.plants import FunctionPlant
from prefcal_env.plants._calls import call
from prefcal_env.plants.equations import Callbacks

SETTINGS = MPCSettings(T_s=0.1, N_p=5, N_u=2, Q_y=[[1.0]], Q_du=[[0.1]])
HERE = Measurement(0.0, np.array([1.0]), np.zeros(1), np.zeros(0), np.zeros(1))


@numba.njit
def called(address, x, u, d, n):
    out = np.empty(n)
    call(address, x, u, d, np.zeros(0), out)
    return out


def plant(f):
    return FunctionPlant(f, states=[Channel("x")], inputs=[Channel("u")])


def test_a_python_method_gets_copies_and_its_result_arrives():
    callbacks = Callbacks(2, 1, 0)

    def method(x, u, d):
        assert d.shape == (0,)
        x *= 2
        return np.append(x, u)

    x = np.array([1.0, 3.0])
    out = called(callbacks.address(method, 3), x, np.array([5.0]), np.zeros(0), 3)
    np.testing.assert_array_equal(out, [2, 6, 5])
    np.testing.assert_array_equal(x, [1, 3])
    callbacks.check()


def test_what_a_method_raises_is_raised_by_the_next_check_and_only_once():
    callbacks = Callbacks(1, 1, 0)

    def method(x, u, d):
        raise KeyboardInterrupt

    address = callbacks.address(method, 1)
    assert np.isnan(called(address, np.zeros(1), np.zeros(1), np.zeros(0), 1)).all()
    with pytest.raises(KeyboardInterrupt):
        callbacks.check()
    callbacks.check()


def test_a_mistake_in_the_equations_of_a_plant_reaches_the_caller_of_the_mpc():
    with pytest.raises(PlantError, match="must return 1 values"):
        LinearMPC(plant(lambda x, u, d: [x[0], u[0]]), SETTINGS).move(HERE)


def test_a_model_that_is_not_finite_leaves_the_step_unsolved():
    move = LinearMPC(plant(lambda x, u, d: x * np.nan), SETTINGS).move(HERE)
    assert not move.solved
    np.testing.assert_array_equal(move.u, HERE.u)
