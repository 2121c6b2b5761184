"""The quick checks of a period agree with the exact ones."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from prefcal_env.envs.overtake.road._kernels import kept, surely_apart
from prefcal_env.envs.overtake.road.contact import BENT, first_contact
from prefcal_env.envs.overtake.road.geometry import REACH
from prefcal_env.envs.overtake.road.rules import ROAD
from prefcal_env.envs.overtake.road.traffic import Obstacle
from prefcal_env.plants.bicycle import Bicycle

TIMES = np.linspace(0, 0.5, 26)


def driving(pose, u, *obstacles):
    """A motion of the bicycle with its inputs held among obstacles, as `first_contact` wants it."""

    def motion(times):
        after = Bicycle().hold(np.array(pose), np.array(u), np.zeros(0), times[times > 0])
        x = after if len(after) == len(times) else np.concatenate([[pose], after])
        return x, [o.poses(times) for o in obstacles]

    return motion


def apart(motion):
    x, others = motion(TIMES)
    return surely_apart(x, np.stack(others), BENT, REACH)


@settings(max_examples=100)
@given(
    y=st.floats(-4, 4), yaw=st.floats(-0.8, 0.8), v=st.floats(11, 19.5),
    steering=st.floats(-0.78, 0.78), x_o=st.floats(-6, 30), speed=st.floats(0, 12),
)  # fmt: skip
def test_who_is_surely_apart_does_not_touch(y, yaw, v, steering, x_o, speed):
    slow = Obstacle(x_o, speed=speed)
    motion = driving((0.0, y, yaw), (v, steering), slow, Obstacle(60.0))
    if apart(motion):
        assert first_contact(motion, TIMES) is None


def test_who_passes_3_m_beside_is_surely_apart():
    assert apart(driving((0.0, 3.0, 0.0), (16.0, 0.0), Obstacle(4.0)))
    assert not apart(driving((0.0, 1.85, 0.0), (16.0, 0.0), Obstacle(4.0)))


def test_who_touches_from_the_start_is_not_apart():
    x, others = np.zeros((1, 3)), np.zeros((1, 1, 3))
    assert not surely_apart(x, others, BENT, REACH)


def test_states_are_kept_up_to_the_last_finite_one():
    x = np.zeros((5, 4))
    assert kept(x, ROAD, 1.0) == (4, 0)
    x[3, 3] = np.inf
    assert kept(x, ROAD, 1.0) == (2, 1)


def test_states_are_kept_up_to_the_first_one_off_the_road():
    x = np.zeros((5, 3))
    x[2:, 1] = 6.2
    assert kept(x, ROAD, 1.0) == (2, 2)
    assert kept(x, ROAD, 1.2) == (4, 0)
    x[1, 2] = np.nan
    assert kept(x, ROAD, 1.0) == (0, 1)
