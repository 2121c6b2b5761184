"""What makes a loop rough, one thing at a time: actuators, sensors, samples and set points."""

from dataclasses import replace

import numpy as np
import pytest

from prefcal_scenarios.cases.loops import LOOPS
from prefcal_scenarios.cases.loops.loop import Actuator


def lag(**changes):
    return replace(LOOPS["lag"](), **changes)


THETA = LOOPS["lag"]().space.decode(np.full(6, 0.5))


def test_a_rough_actuator_stands_at_its_steps_within_its_limits():
    u = lag(actuators=(Actuator(resolution=12.5),)).run(THETA).u[:, 0]
    assert set(np.unique(u)) <= set(np.arange(0, 101, 12.5))
    assert len(np.unique(u)) > 1


def test_an_actuator_that_sticks_moves_by_more_than_its_stiction_or_not_at_all():
    u = lag(actuators=(Actuator(stiction=3.0),)).run(THETA).u[:, 0]
    moves = np.abs(np.diff(u))
    assert (moves[moves > 0] > 3.0).all()
    assert moves.any()


def test_backlash_takes_up_small_turns():
    noisy = lag().run(THETA).u[:, 0]
    played = lag(actuators=(Actuator(backlash=2.0),)).run(THETA).u[:, 0]
    assert np.count_nonzero(np.diff(played)) < np.count_nonzero(np.diff(noisy)) / 2


def test_actuators_that_do_nothing_change_nothing():
    assert lag(actuators=(Actuator(),), resolution=(0.0,)).run(THETA) == lag().run(THETA)


def test_a_coarse_sensor_shows_its_steps_to_the_controller():
    fine, coarse = (lag(resolution=r).run(THETA).kpis["input_noise"] for r in ((), (5.0,)))
    assert fine != coarse


def test_the_controller_acts_at_every_nth_sample():
    space = LOOPS["lag"]().space
    knob = type(space.knobs[0])("every", 1, 8, integer=True)
    slow = lag(space=type(space)([*space.knobs, knob]))
    once, fourth = (slow.run(np.append(THETA, n)) for n in (1.0, 4.0))
    assert len(once.t_control) == pytest.approx(4 * len(fourth.t_control), abs=4)
    assert np.array_equal(once.x, lag().run(THETA).x)


def test_a_second_set_point_is_followed_and_counts_in_overshoot_and_settling_time():
    made = lag()
    task = replace(made.task, y_ref=replace(made.target, steps=((100.0, (43.0,)),)))
    one, two = made.run(THETA), lag(task=task).run(THETA)
    assert set(two.y_ref[:, 0]) == {50.0, 43.0}
    assert two.output(0)[-1] == pytest.approx(43.0, abs=2)
    before = two.t < 100
    assert np.array_equal(one.x[: before.sum()], two.x[: before.sum()])
    assert two.kpis["settling_time"] > one.kpis["settling_time"]
