"""Bodies overlap when they share a point, no contact is missed, and the road ends where it ends."""

from math import pi

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from prefcal_env.envs.overtake.scene import (
    CONTACT,
    ROAD,
    Obstacle,
    corners,
    distance,
    first_contact,
    kept,
    lateral_distance,
    outside,
    separation,
    surely_apart,
)
from prefcal_env.plants.bicycle import Bicycle

TINY = 1e-9
poses = st.tuples(st.floats(-7, 7), st.floats(-7, 7), st.floats(-pi, pi)).map(lambda pose: np.array([pose]))


def boundary(pose: np.ndarray, n: int = 40) -> np.ndarray:
    """Points on the sides of a body, corners included."""
    c = corners(pose)[0]
    share = np.linspace(0, 1, n)[:, None]
    return np.concatenate([c[i] + share * (c[(i + 1) % 4] - c[i]) for i in range(4)])


def holds_a_corner(a: np.ndarray, b: np.ndarray) -> bool:
    """Whether the body at a holds a corner of the one at b, by polar angles of its own frame."""
    c, s = np.cos(a[0, 2]), np.sin(a[0, 2])
    for corner in corners(b)[0]:
        x, y = np.array([[c, s], [-s, c]]) @ (corner - a[0, :2])
        if -4.5 - TINY <= x <= TINY and abs(y) <= 0.9 + TINY:
            return True
    return False


def sides_cross(a: np.ndarray, b: np.ndarray) -> bool:
    """Whether a side of one crosses a side of the other, by the signs of four areas."""

    def area(p: np.ndarray, q: np.ndarray, r: np.ndarray) -> float:
        return (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])

    A, B = corners(a)[0], corners(b)[0]
    for i in range(4):
        for j in range(4):
            p, q, r, s = A[i], A[(i + 1) % 4], B[j], B[(j + 1) % 4]
            if area(p, q, r) * area(p, q, s) < 0 and area(r, s, p) * area(r, s, q) < 0:
                return True
    return False


@given(a=poses, b=poses)
def test_bodies_overlap_when_they_share_a_point(a, b):
    apart = separation(a, b)[0]
    if abs(apart) < 2 * TINY:
        return  # they just touch: rounding decides
    shared = holds_a_corner(a, b) or holds_a_corner(b, a) or sides_cross(a, b)
    assert (separation(a, b)[0] <= 0) == shared


@given(a=poses, b=poses)
def test_the_distance_is_that_of_the_nearest_points(a, b):
    points = boundary(a)[:, None] - boundary(b)[None]
    nearest = np.hypot(*np.moveaxis(points, -1, 0)).min()
    found = distance(a, b)[0]
    assert found >= separation(a, b)[0] - 1e-9
    if separation(a, b)[0] > 0:
        assert nearest - 0.12 <= found <= nearest + 1e-9  # points are 0.12 m apart


@given(a=poses, b=poses)
def test_separation_is_mutual(a, b):
    assert separation(a, b) == pytest.approx(separation(b, a), abs=1e-12)


@pytest.mark.parametrize(
    ("x", "y", "heading", "apart"),
    [
        (4.5, 0.0, 0.0, 0.0),  # nose to tail
        (14.5, 0.0, 0.0, 10.0),
        (0.0, 3.0, 0.0, 1.2),  # side by side
        (-0.9, 0.0, pi / 2, -0.9),  # across its nose
        (3.15, 0.0, pi / 2, 3.15 - 0.9),  # across its way: from x = 2.25 on
    ],
)
def test_separations_by_hand(x, y, heading, apart):
    here, there = np.zeros((1, 3)), np.array([[x, y, heading]])
    assert separation(here, there)[0] == pytest.approx(apart)


def test_the_body_is_behind_its_front_end():
    pose = np.array([[10.0, 1.0, pi / 2]])
    expected = np.array([[9.1, 1.0], [9.1, -3.5], [10.9, -3.5], [10.9, 1.0]])
    assert corners(pose)[0] == pytest.approx(expected)


@given(pose=poses)
def test_outside_is_that_of_the_outermost_corner(pose):
    y = corners(pose)[0, :, 1]
    assert outside(pose)[0] == pytest.approx(max(y.max() - 6, -2 - y.min()))


def test_beside_each_other_the_lateral_distance_counts():
    own = np.array([[10.0, 3.0, 0.0], [14.4, 3.0, 0.0], [14.5, 3.0, 0.0], [5.4, 3.0, 0.0]])
    other = np.tile([10.0, 0.5, 0.0], (4, 1))
    expected = [2.5, 2.5, np.nan, np.nan]
    assert lateral_distance(own, other) == pytest.approx(expected, nan_ok=True)


TIMES = np.linspace(0, 0.5, 26)


def driving(pose, u, *obstacles):
    """A motion: the bicycle with its inputs held, among obstacles."""

    def motion(times):
        after = Bicycle().hold(np.array(pose), np.array(u), np.zeros(0), times[times > 0])
        x = after if len(after) == len(times) else np.concatenate([[pose], after])
        return x, [o.at(times)[:, :3] for o in obstacles]

    return motion


def apart(motion, times):
    own, others = motion(times)
    return np.min([separation(own, other) for other in others], axis=0)


def apart_at_first_sight(motion):
    x, others = motion(TIMES)
    return surely_apart(x, np.stack(others))


drives = given(
    y=st.floats(-4, 4),
    yaw=st.floats(-0.8, 0.8),
    v=st.floats(11, 19.5),
    steering=st.floats(-0.78, 0.78),
    x_o=st.floats(-6, 30),
    speed=st.floats(0, 12),
)


@settings(max_examples=40)
@drives
def test_contacts_agree_with_looking_very_often(y, yaw, v, steering, x_o, speed):
    slow = Obstacle(x_o, speed=speed)
    motion = driving((0.0, y, yaw), (v, steering), slow, Obstacle(60.0))
    often = np.linspace(0, 0.5, 20001)
    seen = np.flatnonzero(apart(motion, often) <= 0)
    touched = first_contact(motion, TIMES)
    if touched is None:
        assert not len(seen)
        return
    assert not apart_at_first_sight(motion)
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
    assert not apart_at_first_sight(motion)


def test_who_passes_3_m_beside_is_surely_apart():
    assert apart_at_first_sight(driving((0.0, 3.0, 0.0), (16.0, 0.0), Obstacle(4.0)))
    assert not apart_at_first_sight(driving((0.0, 1.85, 0.0), (16.0, 0.0), Obstacle(4.0)))


def test_states_are_kept_up_to_the_first_one_off_the_road():
    x = np.zeros((5, 3))
    assert kept(x, ROAD, 1.0) == (4, False)
    x[2:, 1] = 6.2
    assert kept(x, ROAD, 1.0) == (2, True)
    assert kept(x, ROAD, 1.2) == (4, False)
