"""What is measured in an experiment of the car, by hand."""

import numpy as np
import pytest

from prefcal_env.experiments.experiment import End
from prefcal_scenarios.cases.overtake import overtake
from prefcal_scenarios.cases.overtake.kpis import KPIS, compute_kpis, overrun
from support.drives import drive

PAPERS = overtake.run(overtake.references["paper, preferences"])


def test_every_kpi_is_measured():
    assert list(PAPERS.kpis) == [k.name for k in KPIS]
    assert list(compute_kpis(drive())) == [k.name for k in KPIS]


def test_the_papers_laptop_takes_the_papers_time_at_the_papers_optimum():
    assert PAPERS.kpis["t_comp_worst"] == pytest.approx(0.0808, abs=1e-3)
    assert PAPERS.kpis["t_comp_ratio"] == pytest.approx(0.95, abs=0.01)
    assert PAPERS.kpis["t_comp_99"] <= PAPERS.kpis["t_comp_worst"]
    assert overrun(PAPERS) == 0.0


def test_measured_times_are_not_among_the_kpis():
    assert PAPERS.solve_time.max() > 0
    assert not {*PAPERS.solve_time} & {*PAPERS.kpis.values()}


def test_the_lateral_distance_counts_only_beside_the_obstacle():
    # The front end is 10 m behind, 4 m behind, level, 4 m and 10 m ahead of the obstacle's.
    e = drive(x_f=[20, 26, 30, 34, 40], y_f=[0.0, 2.5, 3.5, 2.7, 0.0], obstacle=(30.0, 0.5))
    assert compute_kpis(e)["lateral_distance"] == pytest.approx(2.0)
    alone = drive(x_f=[0, 1, 2, 3, 4], y_f=[0.0] * 5, obstacle=(90.0, 0.0))
    assert compute_kpis(alone)["lateral_distance"] == np.inf


def test_the_clearance_is_between_the_outlines():
    behind = drive(x_f=[0, 1, 2, 3, 4], y_f=[0.0] * 5, obstacle=(90.0, 0.0))
    assert compute_kpis(behind)["clearance"] == pytest.approx(90 - 4.5 - 4)
    beside = drive(x_f=[30.0] * 5, y_f=[3.0] * 5, obstacle=(30.0, 0.0))
    assert compute_kpis(beside)["clearance"] == pytest.approx(1.2)
    oblique = drive(x_f=[22.5] * 5, y_f=[5.8] * 5, obstacle=(30.0, 0.0))
    assert compute_kpis(oblique)["clearance"] == pytest.approx(5.0)  # 3 m ahead, 4 m aside


def test_turned_outlines_touch_with_a_corner():
    # Its rear end is 4.5 m below the front end at 90°.
    turned = drive(x_f=[30.0] * 5, y_f=[6.0] * 5, yaw=[np.pi / 2] * 5, obstacle=(32.0, 0.0))
    assert compute_kpis(turned)["clearance"] == pytest.approx(6.0 - 4.5 - 0.9)


def test_the_path_by_hand():
    phase = [0, 1, 1, 0, 0, 0]
    e = drive(y_f=[0.05, 1.0, 3.4, 2.0, 0.08, -0.3], phase=phase)
    kpis = compute_kpis(e)
    assert kpis["path_peak"] == pytest.approx(3.4)
    assert kpis["overshoot"] == pytest.approx(0.4)
    assert kpis["lane_deviation"] == pytest.approx(0.3)  # the way back does not count
    not_back = drive(y_f=[0.05, 1.0, 3.4, 2.0, 1.5, 1.1], phase=phase)
    assert compute_kpis(not_back)["lane_deviation"] == pytest.approx(1.1)


def test_off_the_road_is_how_far_the_outermost_corner_is():
    assert compute_kpis(drive(y_f=[5.5] * 5))["off_road"] == pytest.approx(5.5 + 0.9 - 6)
    assert compute_kpis(drive(y_f=[0.0] * 5))["off_road"] == 0.0


def test_speed_and_steering_by_hand():
    kmh = np.array([50.0, 54.0, 63.0, 50.0, 50.0])
    degrees = np.array([0.0, 3.0, -1.0, -1.0, 0.0])
    e = drive(T_s=0.5, v=kmh / 3.6, steering=np.radians(degrees), phase=[0, 1, 1, 0, 0])
    kpis = compute_kpis(e)
    # The last instant has no decision: four steps, references 50, 60, 60, 50.
    assert kpis["speed_error"] == pytest.approx(np.sqrt((36 + 9) / 4))
    assert kpis["speed_variation"] == pytest.approx(4 + 9 + 13)
    assert kpis["steering"] == pytest.approx(3.0)
    assert kpis["steering_move"] == pytest.approx(4.0)
    assert kpis["steering_rate"] == pytest.approx(8.0)
    assert kpis["steering_rate_rms"] == pytest.approx(np.sqrt((9 + 16) / 4) / 0.5)
    v, angle = 54 / 3.6, np.radians(3.0)
    a = v**2 * np.sin(2 * angle) / 9
    assert kpis["lateral_acceleration"] == pytest.approx(a)
    assert kpis["lateral_jerk"] == pytest.approx((a + (63 / 3.6) ** 2 * np.sin(np.radians(2.0)) / 9) / 0.5)


def test_the_time_of_overtaking_is_infinite_if_it_does_not_end():
    assert compute_kpis(drive(T_s=0.5, phase=[0, 1, 1, 0, 0]))["overtaking_time"] == 1.0
    assert compute_kpis(drive(T_s=0.5, phase=[0, 1, 1, 1, 1]))["overtaking_time"] == np.inf
    assert compute_kpis(drive(T_s=0.5, phase=[0, 0, 0, 0, 0]))["overtaking_time"] == np.inf


def test_a_collision_is_a_contact_that_ended_the_run():
    touching = {"x_f": [25.5] * 5, "y_f": [0.0] * 5, "obstacle": (30.0, 0.0)}
    assert compute_kpis(drive(**touching, end=End.UNSAFE))["collision"] == 1.0
    assert compute_kpis(drive(y_f=[7.0] * 5, end=End.UNSAFE))["collision"] == 0.0
