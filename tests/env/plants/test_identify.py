"""Identify a plant: the true one is in the intervals, and a record that does not tell is refused."""

import re

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy import signal

from prefcal_env.errors import RecordError
from prefcal_env.plants.explained import Model
from prefcal_env.plants.identify import identify, interval

N = 300
TIME = np.linspace(0, 299, N)
STEPPED = np.where(TIME < 30, 40.0, 46.0)
GAIN, LAG, DELAY, NOISE = 1.8, 25.0, 8.0, 0.05


def output(u=STEPPED, num=(GAIN,), den=(LAG, 1.0), delay=8, seed=0):
    """The output of a plant at 52 with white noise, simulated by scipy; the delay is in rows."""
    num, den, _ = signal.cont2discrete((num, den), 1.0, "zoh")
    late = np.concatenate([np.zeros(delay), u - u[0]])[:N]
    noise = NOISE * np.random.default_rng(seed).standard_normal(N)
    return 52 + signal.lfilter(np.ravel(num), den, late) + noise


@pytest.fixture(scope="module")
def found():
    return identify(TIME, STEPPED, output(), count=100)


def test_the_true_numbers_are_near_the_best_ones_and_in_their_intervals(found):
    best = found.models[found.best]
    assert best.family == "a lag"
    assert best.numbers == pytest.approx({"gain": GAIN, "time constant 1": LAG, "dead time": DELAY}, rel=0.05)
    low, high, _ = interval(found.models, "gain")
    assert low < GAIN < high
    assert high - low < 0.1 * GAIN
    assert found.noise == pytest.approx(NOISE, rel=0.15)
    assert sum(found.families.values()) == pytest.approx(1.0)
    assert next(iter(found.families)) == "a lag"
    assert found.reason.startswith("A lag, ")
    assert found.notes == ()


def test_the_model_lies_over_the_record(found):
    assert found.fit == pytest.approx(found.y, abs=5 * NOISE)


def test_one_seed_gives_the_same_models(found):
    assert identify(TIME, STEPPED, output(), count=100).models == found.models


def test_units_of_the_record_change_nothing_but_the_numbers(found):
    other = identify(TIME / 60, STEPPED / 100, output() * 1000, count=100)
    best, scaled = found.models[found.best], other.models[other.best]
    assert scaled.gain == pytest.approx(best.gain * 1e5, rel=1e-4)
    assert scaled.delay == pytest.approx(best.delay / 60, rel=1e-3)


def test_models_that_are_harder_to_control_come_later(found):
    third = len(found.models) // 3
    assert np.mean([model.delay / model.lags[0] for model in found.models[:third]]) < np.mean(
        [model.delay / model.lags[0] for model in found.models[-third:]]
    )


def test_the_best_model_has_the_dead_time_that_the_record_leaves_open_and_not_none():
    made = identify(TIME, STEPPED, output(delay=0), count=100)
    low, high, _ = interval(made.models, "dead time")
    assert low < made.models[made.best].delay < high


def test_a_coarse_actuator_leaves_the_gain_open(found):
    coarse = identify(TIME, STEPPED, output(), resolution=1.0, count=100)
    (low, high, _), (before, after, _) = (interval(each.models, "gain") for each in (coarse, found))
    assert high - low > 2 * (after - before)


@pytest.mark.parametrize(
    ("num", "den", "name", "expected"),
    [
        ((0.02,), (1.0, 0.0), "rate", 0.02),
        ((-12.0, GAIN), (15 * 25.0, 40.0, 1.0), "gain", GAIN),
        ((-GAIN,), (400.0, 16.0, 1.0), "damping", 0.4),
    ],
    ids=["integrating", "inverse response", "oscillating, negative gain"],
)
def test_other_plants_are_told_by_their_records(num, den, name, expected):
    # Up and back again: a single step would leave open whether the output settles later.
    u = np.where(TIME < 150, STEPPED, 40.0)
    made = identify(TIME, u, output(u, num, den, delay=3), count=60)
    assert made.models[made.best].numbers[name] == pytest.approx(expected, rel=0.1)


def test_a_controller_in_the_input_is_said_to_be_ambiguous():
    rng = np.random.default_rng(3)
    u = STEPPED + np.cumsum(0.05 * rng.standard_normal(N))
    made = identify(TIME, u, output(u), count=30)
    assert "closed loop" in made.notes[0]
    assert made.models[made.best].gain == pytest.approx(GAIN, rel=0.1)


def test_a_valve_that_sticks_is_noticed_by_what_no_model_explains():
    t = np.arange(400.0)
    u = np.select([t < 40, t < 140, t < 240], [40.0, 42.0, 44.0], 42.0)
    moved = np.select(
        [t < 140, t < 240], [40.0, 44.0], 44.0
    )  # the first move and the last one do not get through
    num, den, _ = signal.cont2discrete(([1.5], [30, 1]), 1.0, "zoh")
    noise = 0.05 * np.random.default_rng(1).standard_normal(400)
    sticking, free = (signal.lfilter(np.ravel(num), den, v - 40) + noise for v in (moved, u))
    (note,) = identify(t, u, sticking, count=50).notes
    assert note.startswith("No model explains the response: what is left has a standard deviation of ")
    assert identify(t, u, free, count=50).notes == ()


def test_rows_need_not_be_equally_spaced():
    kept = np.sort(np.random.default_rng(5).choice(N, 200, replace=False))
    made = identify(TIME[kept], STEPPED[kept], output()[kept], count=30)
    assert made.models[made.best].gain == pytest.approx(GAIN, rel=0.05)


@pytest.mark.parametrize(
    "start", [1500, 1503, 1509], ids=["kept", "soon after a kept row", "just before one"]
)
def test_a_long_record_has_the_same_dead_time_whichever_rows_are_kept(start):
    n, h = 15_000, 0.02
    u = np.where(np.arange(n) < start, 40.0, 46.0)
    num, den, _ = signal.cont2discrete(([GAIN], [LAG, 1.0]), h, "zoh")
    late = np.concatenate([np.zeros(400), u - 40])[:n]
    noise = NOISE * np.random.default_rng(0).standard_normal(n)
    made = identify(h * np.arange(n), u, 52 + signal.lfilter(np.ravel(num), den, late) + noise, count=60)
    assert len(made.t) == 1500
    assert made.models[made.best].delay == pytest.approx(DELAY, abs=0.05)
    low, high, _ = interval(made.models, "dead time")
    assert low < DELAY < high


def test_an_interval_is_over_the_models_that_have_the_number(found):
    swinging = Model("two lags", (1.0,), (9.0, 1.2, 1.0), 0.0)
    low, high, count = interval((*found.models, swinging), "time constant 1")
    assert (low, high) == interval(found.models, "time constant 1")[:2]
    assert count == 100
    assert interval((*found.models, swinging), "1/ω") == pytest.approx((3.0, 3.0, 1))


# --- Records that do not tell, one by one.


def gap(values):
    return np.where(np.arange(N) == 7, np.nan, values)


@pytest.mark.parametrize(
    ("t", "u", "y", "said"),
    [
        (TIME[:20], STEPPED[:20], output()[:20], "30 rows or more .* got 20: log faster"),
        (TIME, STEPPED, output() * 1e120, "the output is 5.*: give it in a unit"),
        (TIME, gap(STEPPED), output(), "the input has no value in row 8 .* cut the record"),
        (TIME, STEPPED, gap(output()), "the output has no value in row 8"),
        (TIME[::-1], STEPPED, output(), "time must increase, .* after row 1: sort"),
        (TIME, np.full(N, 40.0), output(), "no step in the input, which is 40 throughout: step it"),
        (TIME[:35], STEPPED[:35], output()[:35], "too short: it ends 5 rows after .* Log until"),
        (TIME, STEPPED, np.full(N, 52.0), "output is 52 throughout"),
        (TIME, STEPPED, np.minimum(output(), 57.0), "saturated: .* rests at 57, the highest .* smaller step"),
        (TIME, STEPPED[:-1], output(), "as long as each other"),
    ],
)
def test_what_cannot_tell_is_refused_with_what_to_do(t, u, y, said):
    with pytest.raises(RecordError, match=said):
        identify(t, u, y)


def test_a_load_in_the_middle_is_refused_with_its_time():
    loaded = output() + np.where(TIME < 190, 0.0, 3 * (1 - np.exp(-(TIME - 190).clip(0) / LAG)))
    with pytest.raises(RecordError, match=r"something else .* from about 1[789]\d"):
        identify(TIME, STEPPED, loaded)


def test_a_response_that_drowns_in_noise_is_refused():
    noise = np.random.default_rng(8).standard_normal(N)
    with pytest.raises(RecordError, match=r"does not tell: .* Log for longer"):
        identify(TIME, STEPPED, noise)


def held(y, band):
    """What a historian keeps that stores a value only if it moved by more than a band."""
    kept = [y[0]]
    for value in y[1:]:
        kept.append(value if abs(value - kept[-1]) > band else kept[-1])
    return np.array(kept)


def test_a_dead_band_of_a_historian_is_said():
    found = identify(TIME, STEPPED, held(output(), 0.3), count=20)
    assert re.match(
        r"The output repeats its value in 2\d\d of 300 rows and then moves by 0.3", found.notes[0]
    )
    with pytest.raises(RecordError, match=r"dead band of the historian, or a coarse sensor\. Log without"):
        identify(TIME, STEPPED, held(output(), 3.0), count=20)
    y = held(output(), 1.5)
    rows = np.flatnonzero(np.diff(y, prepend=0.0) + np.diff(STEPPED, prepend=0.0))
    with pytest.raises(RecordError, match=r"apart, as where a historian keeps only changes: log without"):
        identify(TIME[rows], STEPPED[rows], y[rows], count=20)


def test_spikes_are_named_and_without_them_the_record_tells_its_plant(found):
    y = output()
    y[[100, 101, 102, 200]] = 999.0, 999.0, 999.0, 0.0
    with pytest.raises(RecordError, match=r"4 rows are far .* at 100 \(999 after 61.*\).* delete these rows"):
        identify(TIME, STEPPED, y, count=20)
    rows = np.abs(y - 60) < 30
    gain = identify(TIME[rows], STEPPED[rows], y[rows], count=20)
    assert gain.models[gain.best].numbers["gain"] == pytest.approx(GAIN, rel=0.02)
    y = output()
    y[150] += 1.0  # less than a fifth of what the output moves by: noise, for all that is known
    identify(TIME, STEPPED, y, count=20)


@pytest.mark.parametrize(("damping", "rows"), [(0.1, 6), (0.1, 10), (0.07, 8)])
def test_a_plant_that_swings_has_no_spikes(damping, rows):
    w, t = 2 * np.pi / rows, np.arange(400.0)
    u = ((t >= 20) & (t < 200)).astype(float)
    fast = np.arange(0, 400, 0.02)
    y = signal.lsim(([w * w], [1, 2 * damping * w, w * w]), np.repeat(u, 50), fast)[1][::50]
    y += 0.005 * np.random.default_rng(0).standard_normal(400)
    made = identify(t, u, y, count=20)
    assert made.models[made.best].gain == pytest.approx(1.0, rel=0.05)


def test_an_output_that_settles_and_is_rounded_is_not_taken_for_saturated():
    made = identify(TIME, STEPPED, np.round(output(), 1), count=30)
    assert made.models[made.best].gain == pytest.approx(GAIN, rel=0.05)


# Beyond what can be computed with, at its end, and usual ones.
sizes = st.sampled_from([1e-320, 1e-99, 1e-9, 1.0, 1e99, 1e308])
values = st.lists(st.floats(-1, 1), min_size=1, max_size=40)


@settings(max_examples=10)
@example(1.0, 0.0, 1.0, 1.0, [0.0] * 12 + [1.0] * 28)  # tells models
@example(1e99, 1e99, -1e-99, 1e-99, [0.0] * 12 + [1.0] * 28)
@example(1e-300, 1e308, -1e308, 1e308, [0.0, 1.0])
@given(sizes, sizes, sizes, sizes, values)
def test_whatever_finite_record_is_given_it_tells_models_or_is_refused_in_words(span, start, size, top, y):
    t, u = span * np.arange(40), start + size * (np.arange(40) >= 8)
    try:
        made = identify(t, u, top * np.resize(y, 40), count=10)
    except RecordError:
        return
    assert len(made.models) == 10
    assert np.isfinite(made.fit).all()
