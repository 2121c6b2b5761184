"""The overtaking as a scenario: knobs, supervisor, KPIs, criteria, and other traffic."""

import json
import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from prefcal_app.report.export import jsonable
from prefcal_env.envs.closed_loop import rollout
from prefcal_env.envs.overtake import Course
from prefcal_env.envs.overtake.scene import DrivePhase
from prefcal_env.errors import KnobError, PlantError, ScenarioError, SettingsError
from prefcal_env.experiments.experiment import End, Experiment, Measurement
from prefcal_env.mpc import LinearMPC
from prefcal_env.plants.bicycle import KMH, Bicycle
from prefcal_env.preferences.answer import Preference
from prefcal_scenarios import load
from prefcal_scenarios.cases.overtake import compute_kpis, overtake
from prefcal_scenarios.cases.overtake.controller import PAPER, STEERING_LIMITS, controller, mpc_settings
from prefcal_scenarios.cases.overtake.kpis import (
    KPIS,
    SHORTEST_DISTANCE,
    building,
    calibrator,
    iterating,
    overrun,
    problem_size,
    step_times,
)
from prefcal_scenarios.own import joined_source
from prefcal_scenarios.scenario import panels_of
from support.drives import drive

OPTIMUM = overtake.references["paper, preferences"]
PAPERS = overtake.run(OPTIMUM)


def test_the_room_is_found_by_name():
    assert load("overtake") is overtake
    assert overtake.space.names == ("T_s", "ε_c", "N_p", "log q_u11", "log q_u22")
    bounds = [(0.085, 0.5), (0.1, 1.0), (10, 30), (-5, 3), (-5, 3)]
    assert [(k.low, k.high) for k in overtake.space] == bounds
    assert [k.integer for k in overtake.space] == [False, False, True, False, False]
    assert overtake.cost is None


def test_the_papers_optimum_overtakes_as_an_independent_implementation_does():
    kpis = PAPERS.kpis
    assert PAPERS.end is End.TIME_UP
    assert PAPERS.solved.all()
    assert (kpis["collision"], kpis["off_road"], kpis["unsolved"]) == (0, 0, 0)
    assert 2.9 <= kpis["lateral_distance"] <= 3.3
    assert 3.0 <= kpis["path_peak"] <= 3.2
    per_step = run_with(STEERING_LIMITS["per step"]).kpis
    assert per_step["path_peak"] == pytest.approx(3.03, abs=0.015)  # the other implementation's


def run_with(fixed):
    return rollout(Course(), controller(OPTIMUM, fixed), OPTIMUM, kpis=compute_kpis)


def test_with_the_toolboxs_slack_weight_the_car_swerves():
    """Deviation in `Fixed`: Q_ε = 10."""
    swerving = run_with(replace(PAPER, Q_eps=1e5))
    assert swerving.end is End.UNSAFE
    assert swerving.kpis["off_road"] > 1
    per_step = run_with(replace(STEERING_LIMITS["per step"], Q_eps=1e5)).kpis
    assert per_step["path_peak"] == pytest.approx(5.9, abs=0.05)
    assert per_step["lateral_distance"] == pytest.approx(3.0, abs=0.01)


def test_hard_limits_are_kept_in_each_phase():
    v, steering = PAPERS.u_control.T
    overtaking = PAPERS.signals["phase"][np.searchsorted(PAPERS.t, PAPERS.t_control - 1e-9)] == 1
    assert v.min() >= 40 / 3.6
    assert v[overtaking].min() >= 50 / 3.6
    assert v.max() <= 70 / 3.6
    assert np.abs(steering).max() <= np.pi / 4
    assert np.abs(np.diff(steering, prepend=0.0)).max() <= 0.0873 + 1e-12


def test_a_run_is_repeatable_and_independent_of_the_seed():
    assert overtake.run(OPTIMUM) == overtake.run(OPTIMUM, seed=5) == PAPERS


INSIDE = [np.random.default_rng([0, i]).random(5) for i in range(6)]
CORNERS = [np.array([corner >> k & 1 for k in range(5)], dtype=float) for corner in (0, 13, 18, 31)]


@pytest.mark.parametrize("z", [*INSIDE, *CORNERS])
def test_anywhere_in_the_box_a_run_ends_with_a_reason_and_exact_in_time(z):
    theta = overtake.space.decode(z)
    e = overtake.run(theta)
    assert e.end in (End.TIME_UP, End.UNSAFE)
    assert np.isfinite(e.x).all()
    assert not np.isnan(list(e.kpis.values())).any()
    T_s = theta[0]
    np.testing.assert_allclose(e.t_control, T_s * np.arange(len(e.t_control)), rtol=0, atol=1e-9)
    if e.end is End.TIME_UP:
        assert e.duration == pytest.approx(T_s * np.ceil(15 / T_s - 1e-9), abs=1e-9)


@pytest.mark.parametrize("theta", [[0.08, 0.3, 16, 0, 0], [0.1, 0.3, 16.5, 0, 0], [0.1, 0.3, 16]])
def test_a_theta_outside_the_box_is_refused(theta):
    for function in (overtake.run, overtake.controller, overtake.settings):
        with pytest.raises(KnobError):
            function(np.array(theta))


def test_the_controller_is_the_papers():
    both = overtake.settings(OPTIMUM)
    json.dumps(jsonable(both), allow_nan=False)
    keeping, overtaking = both["lane keeping"], both["overtaking"]
    for s in (keeping, overtaking):
        assert (s["T_s"], s["N_p"], s["N_u"]) == (0.085, 16, 5)
        assert s["Q_y"] == ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 0.0))
        assert s["Q_du"] == ((pytest.approx(10**0.261), 0.0), (0.0, pytest.approx(10**0.918)))
        assert (s["du_max"], s["Q_eps"]) == ((np.inf, pytest.approx(0.0873 * 0.085)), 10.0)
        assert s["y_max"][2] == -s["y_min"][2] == pytest.approx(np.pi / 4)
    assert (keeping["u_min"][0], keeping["u_max"][0]) == pytest.approx((40 / 3.6, 70 / 3.6))
    assert (overtaking["u_min"][0], overtaking["u_max"][0]) == pytest.approx((50 / 3.6, 70 / 3.6))
    assert (keeping["y_min"][1], overtaking["y_min"][1]) == (-np.inf, 3.0)
    assert overtake.controller(OPTIMUM).T_s == 0.085


def test_panels_show_meters_kmh_and_degrees():
    y, v, steering = panels_of(overtake, PAPERS)
    assert np.array_equal(y.values(PAPERS), PAPERS.x[:, 1])
    assert v.values(PAPERS)[0] == pytest.approx(50.0)
    assert (v.channel.unit, v.channel.low, v.channel.high) == ("km/h", 40, 70)
    assert np.abs(steering.values(PAPERS)).max() == pytest.approx(3.4, abs=0.01)


ROOT = Path(__file__).parents[4]
SLOW = np.array([0.3, 0.5, 12.0, -1.0, 1.0])
DRAWN = {"vehicles_count": 3, "vehicles_density": 0.5}


def configured(config):
    return load(joined_source("overtake", config))


def test_a_configured_scenario_is_configured_anew_not_on_top():
    once = configured({"lanes_count": 3})
    assert "road_left" in once.run(SLOW).signals
    assert "road_left" not in once.configured({}).run(SLOW).signals


@pytest.mark.parametrize("limit", STEERING_LIMITS)
def test_the_limit_of_steering_is_a_setting(limit):
    scenario = configured({"steering_limit": limit})
    e = scenario.run(OPTIMUM)
    largest = np.radians(e.kpis["steering_move"])
    allowed = 0.0873 * (OPTIMUM[0] if limit == "per second" else 1)
    assert largest == pytest.approx(allowed, rel=1e-6)
    assert scenario.settings(OPTIMUM)["overtaking"]["du_max"][1] == pytest.approx(allowed)


def test_both_limits_at_the_papers_optimum():
    kpis = {n: configured({"steering_limit": n}).run(OPTIMUM).kpis for n in STEERING_LIMITS}
    assert kpis["per step"]["path_peak"] == pytest.approx(3.036, abs=1e-3)
    assert kpis["per step"]["lateral_distance"] == pytest.approx(2.9998, abs=1e-4)
    assert kpis["per second"]["path_peak"] == pytest.approx(3.13, abs=5e-3)
    assert kpis["per second"]["lateral_distance"] == pytest.approx(2.97, abs=5e-3)
    assert kpis["per second"]["lateral_acceleration"] == pytest.approx(3.3, abs=0.05)


def test_other_processes_can_run_it():
    run = pickle.loads(pickle.dumps(configured(DRAWN).run))
    assert run(SLOW, 3) == configured(DRAWN).run(SLOW, 3)


@pytest.mark.parametrize(
    ("source", "error", "says"),
    [
        ("overtake {", ScenarioError, "is not JSON"),
        ('cstr {"lanes_count": 3}', ScenarioError, "'cstr' takes no configuration"),
        ('overtaek {"lanes_count": 3}', ScenarioError, "Did you mean .overtake"),
        ('overtake {"lanes": 3}', SettingsError, "lanes"),
        (5, ScenarioError, "loaded by its name, got 5"),
        ('overtake {"steering_limit": "none"}', SettingsError, "per second"),
    ],
)
def test_what_cannot_be_is_refused(source, error, says):
    with pytest.raises(error, match=says):
        load(source)


def test_the_example_of_the_docs_is_one():
    config = json.loads((ROOT / "docs" / "traffic.json").read_text())
    e = configured(config).run(SLOW)
    assert e.signals["road_left"][0] == 10
    assert "obstacle4_x" in e.signals


@pytest.mark.parametrize("i", range(3))
def test_random_tunings_in_traffic_end_with_a_reason_and_on_time(i):
    theta = overtake.space.decode(np.random.default_rng([1, i]).random(5))
    e = configured(DRAWN).run(theta, seed=i)
    instants = theta[0] * np.arange(len(e.t_control))
    np.testing.assert_allclose(e.t_control, instants, rtol=0, atol=1e-9)
    assert np.all(np.diff(e.t) > 0)
    assert e.end is End.TIME_UP or e.kpis["collision"] or e.kpis["off_road"] > 1
    assert not np.isnan(list(e.kpis.values())).any()


def test_the_seed_decides_the_traffic_and_nothing_else_does():
    scenario = configured(DRAWN)
    first = scenario.run(SLOW, seed=1)
    assert scenario.run(SLOW, seed=1) == first
    assert scenario.run(SLOW, seed=2) != first


TWO_SPEEDS = np.array([0.085, 0.31, 16.0, 0.261, 0.918])
FAR, NEAR = 90.0, 12.0
"""x_o [m] before a car at 0: the gap is 85.5 and 7.5 m."""


def see(*obstacles, x=(0.0, 0.0, 0.0), v=50 * KMH, steering=0.0):
    d = np.array(obstacles, dtype=float).ravel()
    return Measurement(0.0, np.array(x), np.array([v, steering]), d, np.zeros(3))


def test_it_keeps_the_lane_at_50_kmh_while_nobody_is_near():
    for seen in (see(), see((FAR, 0.0, 11.1))):
        supervisor = controller(TWO_SPEEDS)
        move = supervisor.move(seen)
        assert supervisor.phase is DrivePhase.LANE_KEEPING
        assert move.solved
        np.testing.assert_allclose(move.u, [50 * KMH, 0.0], atol=1e-6)


def test_it_begins_to_overtake_when_the_obstacle_is_near():
    supervisor = controller(TWO_SPEEDS)
    move = supervisor.move(see((NEAR, 0.0, 11.1)))
    assert supervisor.phase is DrivePhase.OVERTAKING
    assert move.u[0] > 50 * KMH
    assert move.u[1] == pytest.approx(0.0873 * 0.085)  # to the left, as fast as allowed


@pytest.mark.parametrize(
    ("x_o", "phase", "speed", "y"),
    [(FAR, DrivePhase.LANE_KEEPING, 50 * KMH, 0.0), (NEAR, DrivePhase.OVERTAKING, 60 * KMH, 3.0)],
)
def test_each_phase_is_the_mpc_of_its_settings_with_x_ref_running_ahead(x_o, phase, speed, y):
    seen = see((x_o, 0.0, 11.1), x=(1.0, 0.7, 0.05), steering=0.02)
    ahead = 1.0 + speed * 0.085 * np.arange(1, 17)
    y_ref = np.column_stack([ahead, np.full(16, y), np.zeros(16)])
    mpc = LinearMPC(Bicycle(), mpc_settings(TWO_SPEEDS, phase))
    expected = mpc.move(replace(seen, d=np.zeros(0), y_ref=y_ref))
    np.testing.assert_allclose(controller(TWO_SPEEDS).move(seen).u, expected.u, atol=1e-6)


def test_where_the_car_is_along_the_road_makes_no_difference():
    here = see((NEAR, 0.0, 11.1), x=(0.0, 0.5, 0.02))
    far = see((NEAR + 5000.0, 0.0, 11.1), x=(5000.0, 0.5, 0.02))
    np.testing.assert_allclose(
        controller(TWO_SPEEDS).move(here).u, controller(TWO_SPEEDS).move(far).u, atol=1e-9
    )


def test_the_distance_is_kept_from_where_the_obstacle_drives():
    at_zero = see((NEAR, 0.0, 11.1), x=(0.0, 1.0, 0.02))
    aside = see((NEAR, -0.6, 11.1), x=(0.0, 0.4, 0.02))
    np.testing.assert_allclose(
        controller(TWO_SPEEDS).move(at_zero).u, controller(TWO_SPEEDS).move(aside).u, atol=1e-9
    )


def test_a_speed_below_the_new_limit_is_led_to_it_at_the_switch():
    move = controller(TWO_SPEEDS).move(see((NEAR, 0.0, 11.1), v=40 * KMH))
    assert move.solved
    assert move.u[0] >= 50 * KMH


def test_steering_beyond_its_limit_still_leaves_a_solvable_problem():
    move = controller(TWO_SPEEDS).move(see((NEAR, 0.0, 11.1), steering=0.9))
    assert move.solved
    assert move.u[1] == pytest.approx(0.9 - 0.0873 * 0.085)


def test_it_keeps_its_distance_until_it_is_past_and_then_keeps_the_lane():
    supervisor = controller(TWO_SPEEDS)
    seen = []
    for x_f in (0.0, 12.0, 26.0, 27.0):
        supervisor.move(see((NEAR, 0.0, 11.1), x=(x_f, 3.0, 0.0)))
        seen.append(supervisor.phase)
    assert seen == [DrivePhase.OVERTAKING] * 3 + [DrivePhase.LANE_KEEPING]


@pytest.mark.parametrize("d", [np.zeros(2), np.zeros((1, 3))])
def test_disturbances_that_are_no_obstacles_are_refused(d):
    with pytest.raises(PlantError, match="x_o, y_o and v_o of each obstacle"):
        controller(TWO_SPEEDS).move(replace(see(), d=d))


CAR = mpc_settings(np.array([0.1, 0.4, 12, 0.0, 0.0]), DrivePhase.OVERTAKING)


@pytest.mark.parametrize("phase", DrivePhase)
@pytest.mark.parametrize("share", [0.1, 0.4, 1.0])
def test_sizes_are_those_of_the_problem_that_the_mpc_solves(share, phase):
    settings = mpc_settings(np.array([0.1, share, 12, 0.0, 0.0]), phase)
    m = Measurement(0.0, np.zeros(3), np.array([14.0, 0.0]), np.zeros(0), np.zeros(3))
    qp = LinearMPC(Bicycle(), settings).problem(m)
    assert problem_size(settings)[::-1] == qp.G.shape


def test_the_time_by_hand():
    n, m = 11, 18 + 36 + 1
    assert problem_size(CAR) == (n, m)
    assert iterating(CAR) == pytest.approx(m * n**2 + n**3 / 3 + 8 * m * n + 4 * n**2)
    seconds = step_times(CAR, np.array([0, 7]))
    assert seconds[0] == pytest.approx(268 * (7.5e-5 + building(CAR) / 4.9e8))
    each = 268 * (7.5e-6 + iterating(CAR) / 2.2e10)
    assert seconds[1] - seconds[0] == pytest.approx(7 * each)


@pytest.mark.parametrize(("share", "N_p"), [(0.5, 12), (0.4, 13)])
def test_more_of_anything_takes_longer(share, N_p):
    other = mpc_settings(np.array([0.1, share, N_p, 0.0, 0.0]), DrivePhase.OVERTAKING)
    assert step_times(other, np.array([9])) > step_times(CAR, np.array([9]))


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


JUDGE = calibrator()
GOOD = {
    "lateral_distance": 3.0,
    "off_road": 0.0,
    "overshoot": 0.0,
    "lane_deviation": 0.1,
    "lateral_acceleration": 5.0,
    "lateral_jerk_rms": 5.0,
    "speed_error": 1.0,
    "speed_variation": 20.0,
    "steering_rate_rms": 10.0,
    "steering_move": 5.0,
}


def outcome(*, end: End = End.TIME_UP, T_s: float = 0.1, **kpis: float) -> Experiment:
    """A run that was good but for these KPIs."""
    return replace(drive(end=end, T_s=T_s), kpis=GOOD | kpis)


IN_ORDER = [
    {"lateral_distance": 2.8},
    {"off_road": 0.3},
    {"overshoot": 0.5},
    {"lane_deviation": 0.5},
    {"lateral_acceleration": 8.0},
    {"lateral_jerk_rms": 9.0},
    {"speed_error": 3.0},
    {"speed_variation": 40.0},
    {"steering_rate_rms": 15.0},
    {"steering_move": 8.0},
]


@pytest.mark.parametrize("i", range(len(IN_ORDER)))
def test_a_criterion_outweighs_all_that_come_after_it(i):
    bad = outcome(**IN_ORDER[i])
    bad_in_the_rest = outcome(**{k: v for rest in IN_ORDER[i + 1 :] for k, v in rest.items()})
    assert JUDGE.prefer(bad_in_the_rest, bad) is Preference.CHALLENGER
    assert JUDGE.prefer(bad, bad_in_the_rest) is Preference.INCUMBENT


def test_real_time_comes_before_everything_and_the_smaller_excess_is_better(monkeypatch):
    module = "prefcal_scenarios.cases.overtake.kpis"
    monkeypatch.setattr(f"{module}.step_times", lambda settings, n: np.full(len(n), 0.2))
    late, later = outcome(T_s=0.15), outcome(T_s=0.1)
    crashed = outcome(end=End.UNSAFE, T_s=0.3, lateral_distance=0.0)
    assert JUDGE.prefer(crashed, late) is Preference.CHALLENGER
    assert JUDGE.prefer(late, later) is Preference.CHALLENGER
    assert JUDGE.decide(crashed, late)[1].name.startswith("(i) ")


def test_more_distance_than_enough_is_not_noticed():
    assert JUDGE.prefer(outcome(lateral_distance=4.0), outcome()) is Preference.TIE
    below = outcome(lateral_distance=SHORTEST_DISTANCE - 1e-3)
    assert JUDGE.prefer(below, outcome(lateral_distance=SHORTEST_DISTANCE)) is Preference.INCUMBENT


def theta_number(i: int) -> np.ndarray:
    """θ number i of a seeded sample of the box."""
    return overtake.space.decode(np.random.default_rng([0, i]).random(5))


def test_no_cost_has_these_preferences_real_drives_go_round_in_a_circle():
    """Each of three θ is better than the next: costs, with whatever tie band, are transitive."""
    judge = overtake.calibrators["synthetic"]()
    a, b, c = (overtake.run(theta_number(i)) for i in (3, 15, 12))
    decisions = [judge.decide(*pair) for pair in ((a, b), (b, c), (c, a))]
    assert [verdict for verdict, _ in decisions] == [Preference.CHALLENGER] * 3
    assert len({criterion.name for _, criterion in decisions}) > 1


def test_what_is_below_every_just_noticeable_difference_is_a_tie():
    shade = {"overshoot": 0.04, "lateral_acceleration": 5.9, "speed_error": 1.1}
    assert JUDGE.decide(outcome(**shade), outcome()) == (Preference.TIE, None)
