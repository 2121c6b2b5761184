"""The room of the overtaking: knobs, controller, runs at the paper's optimum and in the box."""

import json
from dataclasses import replace

import numpy as np
import pytest

from prefcal_app.report.export import jsonable
from prefcal_env.envs.closed_loop import rollout
from prefcal_env.envs.overtake import Course
from prefcal_env.errors import KnobError
from prefcal_env.experiments.experiment import End
from prefcal_scenarios import load
from prefcal_scenarios.cases.overtake import compute_kpis, overtake
from prefcal_scenarios.cases.overtake.controller import PAPER, STEERING_LIMITS, controller
from prefcal_scenarios.scenario import panels_of

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
