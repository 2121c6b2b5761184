"""No contact is missed, and none is made up."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from prefcal_env.envs.overtake.road.contact import CONTACT, first_contact
from prefcal_env.envs.overtake.road.geometry import separation
from prefcal_env.envs.overtake.road.traffic import Obstacle
from prefcal_env.plants.bicycle import Bicycle


def driving(pose, u, *obstacles):
    """A motion: the bicycle with its inputs held, among obstacles."""

    def motion(times):
        x = Bicycle().hold(np.array(pose), np.array(u), np.zeros(0), times)
        return x, [o.poses(times) for o in obstacles]

    return motion


def apart(motion, times):
    own, others = motion(times)
    return np.min([separation(own, other) for other in others], axis=0)


@settings(max_examples=40)
@given(
    y=st.floats(-4, 4), yaw=st.floats(-0.8, 0.8), v=st.floats(11, 19.5),
    steering=st.floats(-0.78, 0.78), x_o=st.floats(-6, 14), speed=st.floats(0, 12),
)  # fmt: skip
def test_it_agrees_with_looking_very_often(y, yaw, v, steering, x_o, speed):
    motion = driving((0.0, y, yaw), (v, steering), Obstacle(x_o, speed=speed))
    often = np.linspace(0, 0.5, 20001)
    seen = np.flatnonzero(apart(motion, often) <= 0)
    touched = first_contact(motion, np.linspace(0, 0.5, 26))
    if touched is None:
        assert not len(seen)
        return
    assert apart(motion, np.array([touched]))[0] <= CONTACT
    if len(seen):
        assert touched <= often[seen[0]] + 1e-4


def test_a_contact_between_two_instants_is_found():
    motion = driving((0.0, 0.0, 0.0), (100.0, 0.0), Obstacle(20.0, speed=0.0))
    assert (apart(motion, np.array([0.0, 0.5])) > 0).all()
    touched = first_contact(motion, np.array([0.0, 0.5]))
    assert touched == pytest.approx((20 - 4.5) / 100, abs=CONTACT / 100)


def test_passing_closely_is_no_contact():
    motion = driving((0.0, 1.81, 0.0), (100.0, 0.0), Obstacle(20.0, speed=0.0))
    assert first_contact(motion, np.array([0.0, 0.5])) is None


def test_the_first_of_several_contacts_counts():
    others = Obstacle(40.0, speed=0.0), Obstacle(20.0, speed=0.0)
    motion = driving((0.0, 0.0, 0.0), (100.0, 0.0), *others)
    assert first_contact(motion, np.linspace(0, 0.5, 3)) == pytest.approx(0.155, abs=1e-4)


def test_who_touches_from_the_start_touches_at_the_start():
    motion = driving((0.0, 0.0, 0.0), (10.0, 0.0), Obstacle(3.0))
    assert first_contact(motion, np.array([0.0, 0.1])) == 0.0
