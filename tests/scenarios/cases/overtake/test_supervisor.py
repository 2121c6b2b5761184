"""Two MPCs behind one controller, and when it changes from one to the other."""

from dataclasses import replace

import numpy as np
import pytest

from prefcal_env.envs.overtake.scene import Phase
from prefcal_env.errors import PlantError
from prefcal_env.experiments.experiment import Measurement
from prefcal_env.mpc import LinearMPC
from prefcal_env.plants.bicycle import KMH, Bicycle
from prefcal_scenarios.cases.overtake.controller import controller, mpc_settings

OPTIMUM = np.array([0.085, 0.31, 16.0, 0.261, 0.918])
FAR, NEAR = 90.0, 12.0
"""x_o [m] before a car at 0: the gap is 85.5 and 7.5 m."""


def see(*obstacles, x=(0.0, 0.0, 0.0), v=50 * KMH, steering=0.0):
    d = np.array(obstacles, dtype=float).ravel()
    return Measurement(0.0, np.array(x), np.array([v, steering]), d, np.zeros(3))


def test_it_keeps_the_lane_at_50_kmh_while_nobody_is_near():
    for seen in (see(), see((FAR, 0.0, 11.1))):
        supervisor = controller(OPTIMUM)
        move = supervisor.move(seen)
        assert supervisor.phase is Phase.LANE_KEEPING
        assert move.solved
        np.testing.assert_allclose(move.u, [50 * KMH, 0.0], atol=1e-6)


def test_it_begins_to_overtake_when_the_obstacle_is_near():
    supervisor = controller(OPTIMUM)
    move = supervisor.move(see((NEAR, 0.0, 11.1)))
    assert supervisor.phase is Phase.OVERTAKING
    assert move.u[0] > 50 * KMH
    assert move.u[1] == pytest.approx(0.0873 * 0.085)  # to the left, as fast as allowed


@pytest.mark.parametrize(
    ("x_o", "phase", "speed", "y"),
    [(FAR, Phase.LANE_KEEPING, 50 * KMH, 0.0), (NEAR, Phase.OVERTAKING, 60 * KMH, 3.0)],
)
def test_each_phase_is_the_mpc_of_its_settings_with_x_ref_running_ahead(x_o, phase, speed, y):
    seen = see((x_o, 0.0, 11.1), x=(1.0, 0.7, 0.05), steering=0.02)
    ahead = 1.0 + speed * 0.085 * np.arange(1, 17)
    y_ref = np.column_stack([ahead, np.full(16, y), np.zeros(16)])
    mpc = LinearMPC(Bicycle(), mpc_settings(OPTIMUM, phase))
    expected = mpc.move(replace(seen, d=np.zeros(0), y_ref=y_ref))
    np.testing.assert_allclose(controller(OPTIMUM).move(seen).u, expected.u, atol=1e-6)


def test_where_the_car_is_along_the_road_makes_no_difference():
    here = see((NEAR, 0.0, 11.1), x=(0.0, 0.5, 0.02))
    far = see((NEAR + 5000.0, 0.0, 11.1), x=(5000.0, 0.5, 0.02))
    np.testing.assert_allclose(controller(OPTIMUM).move(here).u, controller(OPTIMUM).move(far).u, atol=1e-9)


def test_the_distance_is_kept_from_where_the_obstacle_drives():
    at_zero = see((NEAR, 0.0, 11.1), x=(0.0, 1.0, 0.02))
    aside = see((NEAR, -0.6, 11.1), x=(0.0, 0.4, 0.02))
    np.testing.assert_allclose(
        controller(OPTIMUM).move(at_zero).u, controller(OPTIMUM).move(aside).u, atol=1e-9
    )


def test_a_speed_below_the_new_limit_is_led_to_it_at_the_switch():
    move = controller(OPTIMUM).move(see((NEAR, 0.0, 11.1), v=40 * KMH))
    assert move.solved
    assert move.u[0] >= 50 * KMH


def test_steering_beyond_its_limit_still_leaves_a_solvable_problem():
    move = controller(OPTIMUM).move(see((NEAR, 0.0, 11.1), steering=0.9))
    assert move.solved
    assert move.u[1] == pytest.approx(0.9 - 0.0873 * 0.085)


def test_it_keeps_its_distance_until_it_is_past_and_then_keeps_the_lane():
    supervisor = controller(OPTIMUM)
    seen = []
    for x_f in (0.0, 12.0, 26.0, 27.0):
        supervisor.move(see((NEAR, 0.0, 11.1), x=(x_f, 3.0, 0.0)))
        seen.append(supervisor.phase)
    assert seen == [Phase.OVERTAKING] * 3 + [Phase.LANE_KEEPING]


@pytest.mark.parametrize("d", [np.zeros(2), np.zeros((1, 3))])
def test_disturbances_that_are_no_obstacles_are_refused(d):
    with pytest.raises(PlantError, match="x_o, y_o and v_o of each obstacle"):
        controller(OPTIMUM).move(replace(see(), d=d))
