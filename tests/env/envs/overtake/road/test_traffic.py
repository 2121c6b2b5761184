"""Other vehicles: the paper's obstacle, and the tracks of drivers."""

import numpy as np
import pytest

from prefcal_env.envs.overtake.road.traffic import Obstacle, Track


def test_the_papers_obstacle_drives_40_kmh_from_30_m():
    assert Obstacle().poses(np.array([0.0, 9.0])).tolist() == [[30, 0, 0], [130, 0, 0]]
    assert Obstacle().row(9.0) == pytest.approx((130, 0, 40 / 3.6))
    assert Obstacle().speeds(np.zeros(2)) == pytest.approx([40 / 3.6] * 2)


def test_a_track_is_straight_between_two_instants():
    track = Track()
    track.add(0.0, 10.0, 0.0, 0.0, 12.0)
    track.add(0.5, 16.0, 1.0, 0.1, 14.0)
    assert track.poses(np.array([0.0, 0.25, 0.5])) == pytest.approx(
        np.array([[10, 0, 0], [13, 0.5, 0.05], [16, 1, 0.1]])
    )
    assert track.speeds(np.array([0.25])) == pytest.approx([13.0])
    assert track.row(0.25) == pytest.approx((13.0, 0.5, 13.0))
