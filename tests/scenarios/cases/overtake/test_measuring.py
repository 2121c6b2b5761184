"""Timing the controller, by a clock that is ours."""

from itertools import count

import numpy as np
import pytest

from prefcal_env.errors import SettingsError
from prefcal_env.experiments.control import Measurement, Move
from prefcal_scenarios.cases.overtake import measuring
from prefcal_scenarios.cases.overtake.measuring import TIMED, Timed, timed_steps


class Still:
    """A controller that holds its input."""

    T_s = 0.1

    def move(self, measurement: Measurement) -> Move:
        return Move(measurement.u)


def test_the_shortest_of_several_times_counts():
    timed = Timed([Still(), Still(), Still()], iter([0.0, 3.0, 10.0, 11.0, 20.0, 22.0]).__next__)
    timed.move(Measurement(0.0, np.zeros(3), np.zeros(2), np.zeros(0), np.zeros(3)))
    assert timed.seconds == [1.0]


def test_every_step_of_every_theta_is_timed_and_progress_is_told(monkeypatch):
    monkeypatch.setattr(measuring, "TIMED", TIMED[-2:])
    told, ticks = [], count()

    def track(thetas):
        for theta in thetas:
            told.append(theta)
            yield theta

    steps = timed_steps(1, track, lambda: float(next(ticks)))
    assert told == list(TIMED[-2:])
    assert {s.seconds for s in steps} == {1.0}
    assert {s.size.N_p for s in steps} == {16, 30}
    assert len({s.size for s in steps}) == 4  # two phases each
    assert len(steps) == 2 * (38 - 3)  # 15 s of 0.4 s, the first three steps left out


def test_the_timed_problems_span_the_box():
    assert {theta[2] for theta in TIMED} == {10, 16, 30}
    assert {theta[1] for theta in TIMED} == {0.1, 0.31, 0.65, 1.0}


def test_no_round_is_refused():
    with pytest.raises(SettingsError, match="rounds must be 1 or more, got 0"):
        timed_steps(0)
