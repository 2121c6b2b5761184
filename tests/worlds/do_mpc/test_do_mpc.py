"""Objects with `make_step` as controllers; the gallery runs one of do-mpc itself."""

import numpy as np
import pytest

from prefcal_env import DoMPC, Measurement
from prefcal_env.errors import SettingsError


class Stub:
    """What `DoMPC` uses of a do-mpc controller."""

    def __init__(self, success=True):
        self.x0, self.guessed, self.solver_stats = None, 0, {"success": success, "iter_count": 7}

    def set_initial_guess(self):
        self.guessed += 1

    def make_step(self, x0):
        assert x0.shape == (2, 1)
        return 3 * x0[:1]


def measurement():
    return Measurement(0.0, np.array([1.0, 2.0]), np.zeros(1), np.zeros(0), np.zeros(1))


def test_a_step_returns_the_input_and_the_first_guess_is_set_once():
    mpc = Stub()
    controller = DoMPC(mpc, 0.5)
    for _ in range(2):
        move = controller.move(measurement())
    assert (move.u.tolist(), move.iterations, move.solved) == ([3.0], 7, True)
    assert (controller.T_s, mpc.guessed) == (0.5, 1)


def test_a_failed_solver_counts_as_not_solved():
    assert not DoMPC(Stub(success=False), 0.5).move(measurement()).solved


def test_an_object_without_make_step_or_sampling_time_is_refused():
    with pytest.raises(SettingsError, match="make_step"):
        DoMPC(object(), 0.5)
    with pytest.raises(SettingsError, match="sampling time"):
        DoMPC(Stub())
