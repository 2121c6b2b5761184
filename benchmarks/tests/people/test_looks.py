"""What is seen in curves, on curves whose values are known."""

import numpy as np
import pytest

from prefcal_bench.people import runs_of
from prefcal_bench.people.looks import LOOKS, looks_of
from prefcal_env.experiments.experiment import Channel, Channels, End
from support.short_runs import short_run

CHANNELS = Channels((Channel("level", "m"),), (Channel("valve", "%", 0, 100),), (Channel("level", "m"),))


def run(level, valve, target, channels=CHANNELS):
    n = len(valve)
    u, goal = np.array(valve, dtype=float)[:, None], np.broadcast_to(target, n).astype(float)
    return short_run(
        [1.0],
        t=np.arange(n + 1.0),
        x=np.array(level, dtype=float)[:, None],
        u=np.vstack([u, u[-1:]]),
        t_control=np.arange(float(n)),
        u_control=u,
        y_ref=goal[:, None] if channels.y else np.zeros((n, 0)),
        iterations=np.zeros(n, dtype=int),
        solve_time=np.zeros(n),
        solved=np.ones(n, dtype=bool),
        channels=channels,
        end=End.TIME_UP,
    )


def seen(*arguments, **more):
    return dict(zip(LOOKS, looks_of(run(*arguments, **more)), strict=True))


def test_each_look_is_what_its_name_says():
    found = seen([0, 0.5, 1.2, 0.9, 1, 1, 1, 1, 1], [50, 60, 55, 65, 65, 65.1, 65, 65], 1.0)
    assert found["seen_below"] == pytest.approx(1 + 0.5 + 0.1)
    assert found["seen_above"] == pytest.approx(0.2)
    assert found["seen_swings"] == 2
    assert found["seen_unrest_at_the_end"] == 0
    assert found["seen_turns_of_the_input"] == 2  # moves of 0.1 % are not seen
    assert found["seen_largest_step_of_the_input"] == 10


def test_the_time_outside_a_band_around_a_drawn_curve():
    t = np.arange(101.0)
    slow = 1 - np.exp(-t / 12)
    found = seen(slow, np.full(100, 50.0), 1.0)
    assert found["seen_outside_slow_band"] == 0
    apart = np.abs(np.exp(-t / 12) - np.exp(-t / 4)) > 0.1
    assert found["seen_outside_quick_band"] == np.count_nonzero(apart[:-1]) > 5


def test_the_drawn_curve_follows_a_second_target():
    t = np.arange(101.0)
    target = np.where(np.arange(100) < 50, 1.0, 0.4)
    first = 1 - np.exp(-t / 12)
    level = np.where(t < 50, first, 0.4 + (1 - np.exp(-50 / 12) - 0.4) * np.exp(-(t - 50) / 12))
    found = seen(level, np.full(100, 50.0), target)
    assert found["seen_outside_slow_band"] == 0


def test_a_step_down_is_seen_like_a_step_up():
    level = np.array([0, 0.5, 1.2, 0.9, 1, 1, 1, 1, 1])
    valve = [50, 60, 55, 65, 65, 65, 65, 65]
    assert looks_of(run(level, valve, 1.0)) == pytest.approx(looks_of(run(-level, valve, -1.0)))


def test_without_target_or_input_there_is_nothing_to_see_of_it():
    blind = Channels(CHANNELS.x, CHANNELS.u, ())
    found = seen([0, 1, 1], [50, 60], 1.0, channels=blind)
    assert [np.isinf(value) for value in found.values()] == [True] * 6 + [False] * 2
    assert np.isinf(looks_of(short_run([0.0]))).sum() >= 6


def test_runs_hold_what_was_seen_and_rows_are_taken_with_it():
    one, other = run([0, 1, 1], [50, 60], 1.0), run([0, 2, 2], [50, 80], 2.0)
    these = runs_of((), [one, other])
    assert these.column("seen_largest_step_of_the_input").tolist() == [10, 30]
    taken = these.take(np.array([1]))
    assert taken.column("seen_largest_step_of_the_input").tolist() == [30]
