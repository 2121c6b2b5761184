"""When things happen in a pair: the part of the time axis that is shown first."""

from dataclasses import replace

import numpy as np
import pytest

from prefcal_app.view import Seen
from prefcal_app.view.question import curve, eventful
from prefcal_env.experiments.panels import without_record
from support.looks import LEVEL, THETA, VALVE, run

T = np.linspace(0.0, 48.0, 481)
PANELS = (LEVEL, VALVE)


def made(level, valve=None):
    """A run of 48 h with these curves."""
    valve = np.full(len(T), 5.0) if valve is None else valve
    one = run(THETA)
    return replace(one, t=T, x=np.asarray(level)[:, None], u=np.asarray(valve)[:, None])


def shown(left, right):
    """From when until when things happen in two runs."""
    parts = eventful(PANELS, Seen().frame(PANELS, left, right), left, right)
    return [parts[0][0], parts[-1][1]]


def step(at, tau=0.5):
    """From 8 to the target 2 at a time, in h."""
    return 2 + 6 * np.where(at > T, 1.0, np.exp(-np.clip(T - at, 0.0, None) / tau))


def test_the_time_in_which_nothing_happens_is_left_out_at_both_ends():
    start, end = shown(made(step(20.0)), made(step(21.0)))
    assert 15 < start < 20
    assert 23 < end < 32


def test_the_side_that_is_still_moving_decides():
    quick, slow = made(step(2.0)), made(step(2.0, tau=6.0))
    assert shown(quick, slow) == shown(slow, quick)
    assert shown(quick, slow)[1] > 2 * shown(quick, quick)[1]


def test_a_disturbance_late_in_the_run_is_inside():
    bump = step(2.0) + np.where(np.abs(T - 40) < 1, 1.0, 0.0)
    start, end = shown(made(bump), made(step(2.0)))
    assert start < 2
    assert end > 41


def test_a_curve_that_does_not_come_to_rest_shows_the_whole_time():
    assert shown(made(2 + np.sin(T)), made(step(2.0)))[1] == pytest.approx(48, abs=2.1)


def test_settling_is_by_the_band_of_the_target_and_not_by_the_axis_alone():
    ringing = step(1.0) + 0.1 * np.where(T < 25, np.cos(3 * T), 0.0)  # the axis has 6 m and more
    assert shown(made(ringing), made(step(1.0)))[1] > 25


def test_a_move_of_the_input_counts():
    valve = np.where(T < 30, 5.0, 9.0)
    assert shown(made(step(1.0), valve), made(step(1.0)))[1] > 30


def test_a_step_and_a_load_hours_apart_are_two_parts_and_the_still_time_between_is_none():
    t = np.linspace(0.0, 8.0, 28_801)  # a sample per second
    rise = 2 + 6 * np.exp(-t / 0.02) + np.where(t > 4, (t - 4) / 0.02 * np.exp(-(t - 4) / 0.02), 0.0)
    one = replace(made(step(1.0)), t=t, x=rise[:, None], u=np.full((len(t), 1), 5.0))
    (a, b), (c, d) = eventful(PANELS, Seen().frame(PANELS, one, one), one, one)
    assert a == 0.0
    # 6 m have come within the band of 0.06 m after ln(100) · 0.02 h = 0.092 h
    assert 0.092 < b < 0.15
    assert 3.9 < c <= 4.0
    assert 4.089 < d < 4.15  # x exp(-x) = 0.06 at x = 4.46, which is 0.089 h; the peak was at 0.02 h


def test_a_curve_of_minutes_in_hours_is_drawn_without_kinks():
    t = np.linspace(0.0, 8.0, 28_801)
    y = 2 + 6 * np.exp(-t / 0.02)
    drawn = curve(t, y, held=False)
    assert len(drawn["t"]) < 2500
    between = np.interp(t, drawn["t"], drawn["y"])
    assert np.abs(between - y).max() < 0.01  # of 6 m, 8 s without a point have shown 0.026


@pytest.mark.parametrize(("late", "parts"), [(28.0, 2), (14.0, 1)])
def test_a_load_that_comes_late_is_a_part_of_its_own_if_both_take_less_than_a_third_of_the_time(late, parts):
    # The step takes 2.3 h and the load as long: with what is shown around them, about 8 h in all.
    one = made(step(0.5) + 3.0 * (late < T) * np.exp(-np.clip(T - late, 0, None) / 0.5))
    assert len(eventful(PANELS, Seen().frame(PANELS, one, one), one, one)) == parts


def test_a_drift_between_two_events_keeps_the_time_between():
    drift = step(1.0, tau=0.1) + np.clip(T - 2, 0, 38) * 0.02 + np.where(T > 40, 1.0, 0.0)
    assert shown(made(drift), made(drift))[1] > 40


@pytest.mark.parametrize(("drift", "parts"), [(0.15, 2), (0.45, 1)])  # 1.4 % and 4.2 % of its axis
def test_a_slow_drift_of_an_input_between_a_step_and_a_load_is_not_cut(drift, parts):
    valve = 5.0 + drift * np.clip((T - 2) / 38, 0, 1) + 3.0 * (T > 1) * (T < 2) + 3.0 * (T > 40) * (T < 41)
    one = made(step(1.0, tau=0.1), valve)
    assert len(eventful(PANELS, Seen().frame(PANELS, one, one), one, one)) == parts


def test_two_runs_in_which_nothing_happens_show_the_whole_time():
    still = made(np.full(len(T), 2.0))
    assert shown(still, still) == Seen().frame(PANELS, still, still)["x"]


def test_a_run_without_a_record_leaves_the_time_to_the_other():
    assert shown(made(step(2.0)), without_record(run(THETA))) == shown(made(step(2.0)), made(step(2.0)))
