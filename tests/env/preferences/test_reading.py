"""What people read off KPIs: in steps and digits, targets, and objectives."""

import numpy as np
import pytest

from prefcal_env.preferences.answer import Reading, as_read

READING = Reading({"error": 0.01, "time": 0.0}, {"error": 0.05, "time": 9.0}, frozenset({"error"}))


@pytest.mark.parametrize(
    ("value", "step", "read"),
    [
        (3.139e-7, 0.001, 0.0),
        (0.0014, 0.001, 0.001),
        (2.0004, 0.001, 2.0),
        (0.3, 0.1, 0.3),
        (-0.34, 0.1, -0.3),
        (1.23456, 0.0, 1.235),
        (123456.4, 0.0, 123456.0),
        (3.139e-7, 0.0, 3.139e-7),
        (0.0, 0.0, 0.0),
        (np.inf, 0.1, np.inf),
        (1e-320, 0.0, 0.0),
    ],
)
def test_numbers_are_read_in_steps_and_four_digits(value, step, read):
    assert float(as_read(value, step)) == read


def test_what_is_unknown_stays_unknown():
    assert np.isnan(as_read(np.nan, 0.1))


def test_reading_twice_changes_nothing():
    values = np.random.default_rng(0).lognormal(0.0, 5.0, 500)
    for step in (0.0, 0.1, 0.03):
        once = as_read(values, step)
        assert np.array_equal(as_read(once, step), once)


def test_all_values_that_reach_a_target_are_alike_and_others_are_not():
    errors = READING("error", np.array([0.0, 0.0312, 0.05, 0.062, np.inf]))
    assert errors.tolist() == [0.0, 0.0, 0.0, 0.06, np.inf]
    assert READING("time", np.array([1.0, 2.0])).tolist() == [1.0, 2.0]
    assert READING("other", np.array([1.23456789])).tolist() == [1.23456789]


def test_missed_objectives_are_counted_and_never_is_one():
    kpis = np.array([[0.01, 9.0, 5.0], [0.06, 9.5, 5.0], [0.01, 1.0, np.inf]])
    assert READING.missed(["error", "time", "other"], kpis).tolist() == [0, 2, 1]  # 9 meets "at most 9"
    assert READING.table(["error", "time", "other"], kpis)[0].tolist() == [0.0, 9.0, 5.0]
