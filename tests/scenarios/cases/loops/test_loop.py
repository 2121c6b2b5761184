"""A controller in Python drives a loop."""

import itertools

import numpy as np
import pytest

from prefcal_env.experiments.experiment import End, Move
from prefcal_scenarios.cases.loops import LOOPS

TANK = LOOPS["tank"]()


class Proportional:
    """What the law of a PID does with a gain alone."""

    T_s = 2.0

    def __init__(self, gain, fails=()):
        self.gain, self.fails, self.seen = gain, fails, []

    def move(self, m):
        self.seen.append(m)
        u = TANK.task.u0[0] + self.gain * (m.y_ref[0] - m.x[0])
        return Move(np.array([u]), iterations=3, solved=len(self.seen) not in self.fails)


def test_it_does_what_the_compiled_law_does():
    driven = TANK.by_controller(Proportional(200.0), 2, seed=1)
    values = {"K": 200.0, "T_i": np.inf, "T_t": np.inf, "b": 1.0}
    gains = TANK.controller.make(values, TANK.plant, TANK.task, 2.0)
    same = TANK.by_law(gains, 2, seed=1)
    np.testing.assert_allclose(driven.x, same.x, rtol=1e-12)
    steps = 2 * np.arange(len(driven.solved))
    np.testing.assert_allclose(driven.u[steps], same.u[steps], rtol=1e-12)


def test_steps_are_recorded_and_an_unsolved_one_holds_the_input():
    ticks = itertools.count(0.0, 0.5)
    driven = TANK.by_controller(Proportional(50.0, fails=(4,)), 2, 1, lambda: next(ticks))
    assert len(driven.solved) == len(range(0, len(driven.x) - 1, 2)) == 300
    assert np.flatnonzero(~driven.solved).tolist() == [3]
    assert (driven.iterations == 3).all()
    assert (driven.solve_time == 0.5).all()
    assert driven.u[6] == driven.u[5] != driven.u[8]


def test_it_sees_noisy_measurements_and_no_other_state():
    controller = Proportional(50.0)
    driven = TANK.by_controller(controller, 2, seed=1)
    seen = np.array([m.x for m in controller.seen])
    steps = 2 * np.arange(len(seen))
    assert (seen[:, 0] == driven.x[steps, 0] + TANK.noise(1)[steps, 0]).all()
    assert (seen[:, 1] == TANK.task.x0[1]).all()
    assert [m.u[0] for m in controller.seen[1:]] == driven.u[steps[:-1], 0].tolist()


@pytest.mark.parametrize("hold", [2, 7, 1000])
def test_it_stops_where_a_state_is_unsafe_or_time_is_up(hold):
    high = TANK.by_controller(Proportional(2000.0), hold, seed=1)
    assert (high.x[:-1, 0] <= 1.0).all()
    assert len(high.x) == len(high.u)
    assert len(high.solved) == len(range(0, len(high.x) - 1, hold))
    ended = TANK.end(high.x)
    assert ended is (End.UNSAFE if high.x[-1, 0] > 1.0 else End.TIME_UP)
