"""When to overtake: section IV-B and the geometry of the design."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefcal_env.envs.overtake.scene import Phase, beside, clearance, gap, next_phase

KEEP, PASS = Phase.LANE_KEEPING, Phase.OVERTAKING
positions = st.floats(-200, 200)


def at(*x: float, y: float = 0.0) -> np.ndarray:
    return np.array([(x_o, y, 11.0) for x_o in x]).reshape(-1, 3)


def test_gap_and_clearance_are_between_the_bodies():
    assert gap(0.0, 30.0) == 25.5
    assert clearance(30.0, 0.0) == 25.5
    assert gap(10.0, np.array([30.0, 40.0])).tolist() == [15.5, 25.5]


@pytest.mark.parametrize(
    ("before", "x_f", "after"),
    [
        (KEEP, 0.0, KEEP),
        (KEEP, 15.5, KEEP),  # gap 10
        (KEEP, 15.6, PASS),
        (KEEP, 25.5, KEEP),  # gap 0
        (PASS, 15.0, PASS),  # fell back: it is not passed yet
        (PASS, 30.0, PASS),
        (PASS, 44.5, PASS),  # clearance 10
        (PASS, 44.6, KEEP),
    ],
)
def test_the_paper_overtakes_from_10_m_behind_to_10_m_ahead(before, x_f, after):
    assert next_phase(before, x_f, at(30.0)) is after


def test_on_an_empty_road_the_lane_is_kept():
    assert next_phase(KEEP, 0.0, at()) is KEEP
    assert next_phase(PASS, 0.0, at()) is KEEP


def test_a_second_obstacle_is_overtaken_in_its_turn():
    assert next_phase(PASS, 45.0, at(30.0, 200.0)) is KEEP
    assert next_phase(KEEP, 190.0, at(30.0, 200.0)) is PASS
    assert next_phase(PASS, 45.0, at(30.0, 55.0)) is PASS  # gap 5.5 to the second


def test_who_drives_in_the_left_lane_is_not_overtaken():
    assert next_phase(KEEP, 20.0, at(30.0, y=4.0)) is KEEP
    assert len(beside(20.0, at(30.0, y=4.0))) == 0


@given(phase=st.sampled_from(Phase), x_f=positions, x_o=st.lists(positions, max_size=4))
def test_the_order_of_obstacles_does_not_matter(phase, x_f, x_o):
    assert next_phase(phase, x_f, at(*x_o)) is next_phase(phase, x_f, at(*reversed(x_o)))


@given(x_f=positions, x_o=positions)
def test_one_obstacle_beside_means_overtaking_goes_on(x_f, x_o):
    if len(beside(x_f, at(x_o))):
        assert next_phase(PASS, x_f, at(x_o)) is PASS
