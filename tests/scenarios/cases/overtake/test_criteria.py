"""The calibrator with criteria (i) to (vi)."""

from dataclasses import replace

import numpy as np
import pytest

from prefcal_env.experiments.experiment import End, Experiment
from prefcal_env.preferences.answer import Preference
from prefcal_scenarios.cases.overtake import overtake
from prefcal_scenarios.cases.overtake.kpis import SHORTEST_DISTANCE, calibrator
from support.drives import drive

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


def test_a_run_that_crashed_loses_and_the_longer_survived():
    fine, crashed = outcome(overshoot=2.0), outcome(end=End.UNSAFE, T_s=0.1)
    later = outcome(end=End.UNSAFE, T_s=0.2)
    assert JUDGE.prefer(crashed, fine) is Preference.INCUMBENT
    assert JUDGE.prefer(later, crashed) is Preference.CHALLENGER


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
