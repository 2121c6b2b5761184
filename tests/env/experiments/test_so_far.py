"""The beginning of a run bounds what the whole run can become."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefcal_env import End, recorded, tracking_kpis
from prefcal_env.errors import ExperimentError
from prefcal_env.experiments.so_far import tracking_bounds, until

TIMES = np.arange(11.0)


def run(level, valve):
    return recorded(
        [1.0], TIMES, {"level": level}, {"valve": valve}, {"level": 1.0}, bands={"level": 0.1}
    )


def test_a_run_is_cut_at_the_last_instant_that_is_not_later():
    whole = run(np.linspace(0, 1, 11), np.arange(11.0))
    part = until(whole, 3.7)
    assert part.t.tolist() == [0, 1, 2, 3]
    assert part.t_control.tolist() == [0, 1, 2]  # the last instant decides nothing
    assert part.end is End.CUT_SHORT
    assert part.end.interrupted
    assert part.kpis == {}
    assert part.duration == 3.0


def test_nothing_is_left_of_a_run_before_its_first_instant():
    with pytest.raises(ExperimentError, match="before the first instant, got -1"):
        until(run(np.ones(11), np.ones(11)), -1.0)


def test_bounds_by_hand():
    level = np.array([0.0, 0.5, 1.2, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0])
    found = tracking_bounds(until(run(level, np.array([0.0, 2.0] + [1.0] * 9)), 3.0))
    assert found["integrated error of level"] == pytest.approx(1.0 + 0.5 + 0.2)
    assert found["overshoot of level"] == pytest.approx(0.2)
    assert found["settling time of level"] == 3.0
    assert found["total move of valve"] == pytest.approx(2.0 + 1.0)
    assert "final error of level" not in found


@given(
    st.lists(st.floats(-3, 3), min_size=11, max_size=11),
    st.lists(st.floats(-3, 3), min_size=11, max_size=11),
)
def test_bounds_never_exceed_the_kpis_of_the_whole_run_and_never_fall(level, valve):
    whole = run(np.array(level), np.array(valve))
    final, before = tracking_kpis(whole), dict[str, float]()
    for time in TIMES[2:]:
        found = tracking_bounds(until(whole, time))
        for name, bound in found.items():
            assert bound <= final[name] + 1e-9
            assert bound >= before.get(name, 0.0) - 1e-9
        before = found


def test_without_a_band_the_settling_time_has_no_bound():
    curve = recorded([1.0], TIMES, {"level": np.linspace(0, 1, 11)}, {}, {"level": 1.0})
    assert "settling time of level" in tracking_kpis(curve)
    assert "settling time of level" not in tracking_bounds(until(curve, 5.0))
