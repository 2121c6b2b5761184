"""Generic KPIs of a trajectory, by hand on curves that can be integrated in the head."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from prefcal_env import Channel, Channels, End, Experiment, tracking_kpis

LEVEL, VALVE = Channel("level", "m"), Channel("valve", "%")


def run(level, valve=(0.0, 4.0, 1.0), reference=2.0, *, band=None, t=None, signal=False):
    """An experiment of one output, one input decided at the first instants."""
    level = np.asarray(level, dtype=float)
    t = np.arange(len(level), dtype=float) if t is None else t
    n = len(valve)
    y = Channel("level", "m", band=band)
    return Experiment(
        theta=np.array([1.0]),
        t=t,
        x=np.zeros((len(t), 1)) if signal else level[:, None],
        u=np.zeros((len(t), 1)),
        t_control=t[:n],
        u_control=np.array(valve)[:, None],
        y_ref=np.full((n, 1), reference),
        iterations=np.zeros(n, int),
        solve_time=np.zeros(n),
        solved=np.ones(n, bool),
        end=End.TIME_UP,
        channels=Channels(x=(Channel("other") if signal else LEVEL,), u=(VALVE,), y=(y,)),
        signals={"level": level} if signal else {},
    )


def test_a_curve_by_hand():
    kpis = tracking_kpis(run([6.0, 4.0, 1.0, 2.0, 2.0]))  # errors 4, 2, -1, 0, 0
    assert kpis == {
        "integrated error of level": 7.0,
        "late error of level": 4.0,  # 2 at 1 s, 1 at 2 s
        "settling time of level": 3.0,
        "overshoot of level": 1.0,
        "final error of level": 0.0,
        "total move of valve": 7.0,
        "largest move of valve": 4.0,
        "RMS move of valve": pytest.approx(np.sqrt((16 + 9) / 2)),
    }


def test_the_start_of_time_does_not_matter():
    level = [6.0, 4.0, 1.0, 2.0, 2.0]
    shifted = tracking_kpis(run(level, t=np.arange(5.0) + 100.0))
    assert shifted == pytest.approx(tracking_kpis(run(level)))


def test_a_curve_that_never_settles_is_infinite_and_a_band_counts():
    assert tracking_kpis(run([6.0, 4.0, 3.0]))["settling time of level"] == np.inf
    assert tracking_kpis(run([6.0, 4.0, 3.0], band=1.5))["settling time of level"] == 2.0
    assert tracking_kpis(run([2.0, 2.0, 2.0]))["settling time of level"] == 0.0


def test_overshoot_is_beyond_the_reference_from_either_side():
    from_below = tracking_kpis(run([0.0, 1.0, 5.0, 2.0]))
    from_above = tracking_kpis(run([6.0, 5.0, 3.0, 2.0]))
    assert from_below["overshoot of level"] == 3.0
    assert from_above["overshoot of level"] == 0.0


def test_an_output_may_be_a_signal_and_one_that_is_neither_is_left_out():
    assert "overshoot of level" in tracking_kpis(run([6.0, 1.0, 2.0], signal=True))
    unknown = replace(run([6.0, 1.0, 2.0]), channels=Channels((LEVEL,), (VALVE,), (VALVE,)))
    assert not any("error" in name for name in tracking_kpis(unknown))


def test_without_a_record_or_with_holes_nothing_is_said():
    nothing = run([6.0, 4.0, 1.0])
    empty = replace(
        nothing,
        t=np.zeros(0),
        x=np.zeros((0, 1)),
        u=np.zeros((0, 1)),
        t_control=np.zeros(0),
        u_control=np.zeros((0, 1)),
        y_ref=np.zeros((0, 1)),
        iterations=np.zeros(0, int),
        solve_time=np.zeros(0),
        solved=np.zeros(0, bool),
        end=End.FAILED,
    )
    assert tracking_kpis(empty) == {}
    assert not any("error" in name for name in tracking_kpis(run([1.0, 2.0, 3.0], reference=np.nan)))


@given(arrays(float, st.integers(3, 12), elements=st.floats(-1e100, 1e100)))
def test_every_kpi_is_a_number_that_is_not_negative(level):
    kpis = tracking_kpis(run(level))
    assert len(kpis) == 8
    assert all(value >= 0 for value in kpis.values())
