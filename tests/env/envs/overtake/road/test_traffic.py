"""Other vehicles drive straight, and may brake."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefcal_env.envs.overtake.road.traffic import Obstacle, rows
from prefcal_env.errors import SettingsError


def test_the_papers_obstacle_drives_40_kmh_from_30_m():
    assert Obstacle().poses(np.array([0.0, 9.0])).tolist() == [[30, 0, 0], [130, 0, 0]]


def test_braking_by_hand():
    # 20 m/s, from 1 s on 5 m/s²: stands at 5 s after 20 + 40 m.
    obstacle = Obstacle(0.0, 1.0, 20.0, 5.0, brakes_at=1.0)
    t = np.array([1.0, 3.0, 5.0, 9.0])
    assert obstacle.poses(t)[:, 0] == pytest.approx([20, 50, 60, 60])
    assert obstacle.speeds(t) == pytest.approx([20, 10, 0, 0])
    assert rows((obstacle, Obstacle()), t)[1, 0] == pytest.approx([50, 1, 10])


@given(speed=st.floats(0, 30), braking=st.floats(0, 10), begin=st.floats(0, 10))
def test_the_position_is_the_integral_of_the_speed(speed, braking, begin):
    obstacle = Obstacle(0.0, 0.0, speed, braking, begin)
    t = np.linspace(0, 15, 3001)
    driven = np.trapezoid(obstacle.speeds(t), t)
    assert obstacle.poses(t[-1:])[0, 0] == pytest.approx(driven, abs=1e-3)


@pytest.mark.parametrize("bad", [{"x": np.nan}, {"speed": -1.0}, {"brakes_at": np.inf}])
def test_an_impossible_obstacle_is_refused(bad):
    with pytest.raises(SettingsError, match=next(iter(bad))):
        Obstacle(**bad)
