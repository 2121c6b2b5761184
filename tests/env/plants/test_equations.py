"""Kernels call the equations of every plant: compiled ones, or its Python methods."""

import math
import pickle
import threading

import numba
import numpy as np
import pytest

from prefcal_env.errors import PlantError
from prefcal_env.experiments.experiment import Channel, Measurement
from prefcal_env.mpc import LinearMPC, MPCSettings
from prefcal_env.plants import FunctionPlant
from prefcal_env.plants._dop853 import call
from prefcal_env.plants.bicycle import Bicycle
from prefcal_env.plants.plant import Callbacks

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


def test_what_a_method_raises_in_one_thread_is_not_raised_in_another():
    callbacks, raised = Callbacks(1, 1, 0), []

    def method(x, u, d):
        raise ValueError

    def work():
        called(callbacks.address(method, 1), np.zeros(1), np.zeros(1), np.zeros(0), 1)
        begun.set()
        done.wait()
        with pytest.raises(ValueError):
            callbacks.check()
        raised.append(True)

    begun, done = threading.Event(), threading.Event()
    thread = threading.Thread(target=work)
    thread.start()
    begun.wait()
    callbacks.check()
    done.set()
    thread.join()
    callbacks.check()
    assert raised


@pytest.mark.parametrize(
    ("errors", "states", "expected"),
    [
        ([ValueError], [1.0], None),
        ([ValueError], [np.nan], ValueError),
        ([ValueError, PlantError], [1.0], PlantError),
        ([ZeroDivisionError, KeyboardInterrupt], [1.0], KeyboardInterrupt),
    ],
)
def test_a_finite_simulation_raises_mistakes_and_interruptions_only(errors, states, expected):
    callbacks, left = Callbacks(1, 1, 0), list(errors)

    def method(x, u, d):
        raise left.pop(0)

    address = callbacks.address(method, 1)
    for _ in errors:
        called(address, np.zeros(1), np.zeros(1), np.zeros(0), 1)
    if expected is None:
        callbacks.check(np.array([states]))
    else:
        with pytest.raises(expected):
            callbacks.check(np.array([states]))
    callbacks.check()


@pytest.mark.parametrize(
    ("f", "error", "words"),
    [
        (lambda x, u, d: [math.sqrt(-1 - x[0] ** 2)], ValueError, r"math domain|nonnegative"),
        (lambda x, u, d: [x[0], u[0]], PlantError, "must return 1 values"),
    ],
)
def test_what_the_equations_raise_reaches_the_caller_of_the_mpc(f, error, words):
    with pytest.raises(error, match=words):
        LinearMPC(plant(f), SETTINGS).move(HERE)


def test_equations_cannot_be_pickled():
    with pytest.raises(TypeError, match="pickle the plant"):
        pickle.dumps(Bicycle().equations)


def test_a_model_that_is_not_finite_leaves_the_step_unsolved():
    move = LinearMPC(plant(lambda x, u, d: x * np.nan), SETTINGS).move(HERE)
    assert not move.solved
    np.testing.assert_array_equal(move.u, HERE.u)
