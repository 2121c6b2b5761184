"""KPIs are those of events: the right values follow from closed forms, at any sampling and moment."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from prefcal_env import recorded
from prefcal_env.experiments.events import Response, noise_of


def response(s, damping):
    """Unit step response of 1/(s² + 2 d s + 1), by its formula."""
    s, root = np.maximum(s, 0.0), np.sqrt(1 - damping**2)
    return 1 - np.exp(-damping * s) * (np.cos(root * s) + damping / root * np.sin(root * s))


def overshoot(damping):
    """Largest distance of that response beyond 1."""
    return np.exp(-np.pi * damping / np.sqrt(1 - damping**2))


def kpis(t, y, ref, **more):
    found = recorded([1.0], t, {"y": y}, reference={"y": ref}, **more).kpis
    return {name.removesuffix(" of y"): value for name, value in found.items()}


def kinds(t, y, ref):
    return [event.kind for event in Response.of(t, y, np.broadcast_to(ref, t.shape).astype(float)).events]


T = np.arange(0, 60, 0.05)

moments = st.floats(0.5, 20)
damped = st.floats(0.2, 0.9)
sizes = st.sampled_from([-25.0, -1.0, 0.02, 4.0, 1e5])


@settings(deadline=None)
@given(damped, moments, sizes, st.floats(-1e3, 1e3), st.sampled_from([0.02, 0.05, 0.1]), st.floats(-1e6, 1e6))
def test_a_step_has_its_values_whenever_it_comes(damping, moment, size, level, step, origin):
    t = np.arange(0, 60, step)
    start = t[np.searchsorted(t, moment)]
    y = level + size * response(t - start, damping)
    ref = np.where(t >= start, level + size, level)
    found = kpis(t + origin, y, ref)
    assert found["overshoot"] == pytest.approx(abs(size) * overshoot(damping), abs=2 * step**2 * abs(size))
    alone = kpis(t, level + size * response(t, damping), level + size)
    assert found["settling time"] == pytest.approx(alone["settling time"], abs=1.01 * step)
    assert found["integrated error"] == pytest.approx(alone["integrated error"], rel=1e-2)
    assert found["late error"] == pytest.approx(alone["late error"], rel=3e-2)
    assert "lag" not in found
    assert "recovery time" not in found


@pytest.mark.parametrize("damping", [0.2, 0.5, 0.7])
def test_the_settling_time_is_that_of_the_closed_form(damping):
    fine = np.linspace(0, 60, 600_001)
    outside = np.abs(response(fine, damping) - 1) > 0.03
    settled = fine[outside][-1]
    found = kpis(T, 3 + 2 * response(T - 7, damping), np.where(T >= 7, 5.0, 3.0))
    assert found["settling time"] == pytest.approx(settled, abs=0.06)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("noise", [0.002, 0.01, 0.05])
def test_noise_in_a_rest_decides_nothing(noise, seed):
    y = 20 + 10 * response(T - 10, 0.6)
    noisy = y + 10 * noise * np.random.default_rng(seed).standard_normal(len(T))
    ref = np.where(T >= 10, 30.0, 20.0)
    assert kinds(T, noisy, ref) == ["step"]
    found, sure = kpis(T, noisy, ref), kpis(T, y, ref)
    assert found["overshoot"] == pytest.approx(sure["overshoot"], abs=45 * noise)
    if noise < 0.05:
        assert found["settling time"] == pytest.approx(sure["settling time"], abs=1.0)


@pytest.mark.parametrize("noise", [0.0, 0.002, 0.01])
def test_several_changes_give_the_worst(noise):
    rng = np.random.default_rng(0)
    y = 20 + 10 * response(T, 0.4) - 5 * response(T - 30, 0.4) + 10 * noise * rng.standard_normal(len(T))
    ref = np.where(T < 30, 30.0, 25.0)
    assert kinds(T, y, ref) == ["start", "step"]
    found = kpis(T, y, ref)
    assert found["overshoot"] == pytest.approx(10 * overshoot(0.4), abs=45 * noise + 0.01)
    alone = kpis(T[T < 30], y[T < 30], 30.0)
    assert found["settling time"] == pytest.approx(alone["settling time"], abs=1.0)


def test_a_step_back_is_judged_in_its_own_direction():
    up, down = response(T - 5, 0.9), response(T - 30, 0.2)
    found = kpis(T, 20 + 10 * up - 10 * down, np.where((T >= 5) & (T < 30), 30.0, 20.0))
    assert found["overshoot"] == pytest.approx(10 * overshoot(0.2), rel=1e-2)


@pytest.mark.parametrize("slope", [-2.0, 0.5])
@pytest.mark.parametrize("constant", [0.5, 2.0])
def test_a_ramp_has_a_lag_and_an_error_and_no_overshoot(slope, constant):
    ref = 10 + slope * np.maximum(T - 5, 0.0)
    s = np.maximum(T - 5, 0.0)
    y = 10 + slope * (s - constant * (1 - np.exp(-s / constant)))  # first order
    found = kpis(T, y, ref)
    assert kinds(T, y, ref) == ["ramp"]
    assert found["overshoot"] == 0.0
    assert found["lag"] == pytest.approx(constant, rel=2e-2)
    missing = abs(slope) * constant * (s[-1] - constant * (1 - np.exp(-s[-1] / constant)))
    assert found["integrated error"] == pytest.approx(missing, rel=1e-2)


def test_beyond_the_end_of_a_ramp_is_an_overshoot():
    ref = np.clip(T - 5, 0, 10)
    # The ramp is an integrated step: its response is that of the step, integrated.
    fine = np.cumsum(response(T - 5, 0.2) - response(T - 15, 0.2)) * 0.05
    found = kpis(T, fine, ref)
    assert kinds(T, fine, ref) == ["ramp"]
    assert found["overshoot"] == pytest.approx(fine.max() - 10, abs=0.03)
    assert found["settling time"] < np.inf


def test_a_ramp_that_is_logged_in_small_steps_is_a_ramp():
    ref = np.floor(np.clip(T - 5, 0, 20) / 0.5) * 0.5
    y = np.clip(T - 7, 0, 20)
    assert kinds(T, y, ref) == ["ramp"]
    assert kpis(T, y, ref)["overshoot"] == 0.0


def loaded(t, at, size):
    """Response to a load on a loop that rejects it."""
    s = np.maximum(t - at, 0.0)
    return size * s * np.exp(1 - s)


@pytest.mark.parametrize("size", [-3.0, 3.0])
def test_a_load_is_no_overshoot_of_the_step_before(size):
    y = 20 + 10 * response(T - 5, 0.6) + loaded(T, 35, size)
    ref = np.where(T >= 5, 30.0, 20.0)
    assert kinds(T, y, ref) == ["step", "load"]
    found, alone = kpis(T, y, ref), kpis(T, y - loaded(T, 35, size), ref)
    assert found["overshoot"] == alone["overshoot"]
    assert found["settling time"] == alone["settling time"]
    s = np.linspace(1, 20, 100_000)
    recovered = s[np.abs(loaded(s, 0, 3.0)) > 0.3][-1]
    assert found["recovery time"] == pytest.approx(recovered, abs=0.2)


@pytest.mark.parametrize("first", [0.0, 0.01, -0.01])
def test_of_a_load_alone_the_largest_error_counts(first):
    y = 20 + loaded(T, 35, -3.0)
    y[0] += first
    found = kpis(T, y, 20.0)
    assert found["overshoot"] == pytest.approx(3.0, rel=1e-3)
    assert found["settling time"] == found["recovery time"] < 10


def test_a_slow_overshoot_is_no_load():
    slow = 0.15 * T / 20 * np.exp(1 - T / 20)
    found = kpis(T, 1 - np.exp(-T) + slow, 1.0)
    assert found["overshoot"] == pytest.approx(0.15, rel=1e-2)
    assert "recovery time" not in found


def test_an_offset_before_a_step_is_no_overshoot():
    """A proportional controller ends below its reference; then the reference comes down to meet it."""
    y = np.where(T < 30, 28 - 8 * np.exp(-T), 27.1 + 0.9 * np.exp(-np.maximum(T - 30, 0)))
    assert kpis(T, y, np.where(T < 30, 30.0, 29.0))["overshoot"] == 0.0


def test_what_changes_with_the_last_row_is_not_judged():
    ref = np.where(T[-1] > T, 30.0, 0.0)
    y = 20 + 10 * response(T, 0.5)
    assert kpis(T, y, ref)["settling time"] == kpis(T, y, 30.0)["settling time"] < np.inf


def test_a_logged_set_point_may_be_noisy():
    ref = np.where(T >= 10, 30.0, 20.0) + 0.01 * np.random.default_rng(1).standard_normal(len(T))
    y = 20 + 10 * response(T - 10, 0.5)
    assert kinds(T, y, ref) == ["step"]
    assert kpis(T, y, ref)["overshoot"] == pytest.approx(10 * overshoot(0.5), abs=0.05)


@pytest.mark.parametrize("step", [1.0, 10.0, 30.0])
def test_areas_do_not_depend_on_the_sampling(step):
    t = np.arange(0, 600.1, step)
    found = kpis(t, 30 - 10 * np.exp(-t / 60), 30.0)
    assert found["integrated error"] == pytest.approx(600 * (1 - np.exp(-10)), rel=0.025)
    assert found["late error"] == pytest.approx(60 * 600, rel=0.05)


def test_a_crossing_between_two_samples_has_the_area_that_is_drawn():
    assert kpis([0.0, 1.0], [1.0, 3.0], 2.0)["integrated error"] == pytest.approx(0.5)


def test_an_oscillation_is_no_noise():
    assert noise_of(T, np.sin(9 * T)) == 0.0


def test_a_step_after_a_long_rest_is_a_step():
    """Two hours of rest: all that happens lies in the last 2 % of the record."""
    t = np.append(np.arange(-7200.0, 0.0, 10.0), T)
    y, ref = 20 + 10 * response(t - 10, 0.5), np.where(t >= 10, 30.0, 20.0)
    assert kinds(t, y, ref) == ["step"]
    short = kpis(T, 20 + 10 * response(T - 10, 0.5), np.where(T >= 10, 30.0, 20.0))
    assert kpis(t, y, ref) == pytest.approx(short)


@pytest.mark.parametrize("rows", [1, 3, 20])
def test_a_set_point_that_is_taken_away_at_the_end_ends_the_run(rows):
    y, ref = 20 + 10 * response(T - 10, 0.5), np.where(T >= 10, 30.0, 20.0)
    before = kpis(T[:-rows], y[:-rows], ref[:-rows])
    ref[-rows:] = 0.0
    assert kpis(T, y, ref) == before
    assert "recovery time" not in before


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("noise", [0.01, 0.05, 0.1])
def test_the_noise_of_a_set_point_is_no_change_of_it(noise, seed):
    rng = np.random.default_rng(seed)
    ref = np.where(T >= 10, 30.0, 20.0) + noise * rng.standard_normal(len(T))
    y = 20 + 10 * response(T - 10, 0.6)
    assert kinds(T, y, ref) == ["step"]
    assert kpis(T, y, ref)["overshoot"] == pytest.approx(10 * overshoot(0.6), abs=noise)
    s = np.maximum(T - 5, 0.0)
    assert kinds(T, 10 + s - 2 * (1 - np.exp(-s / 2)), 10 + s + noise * rng.standard_normal(len(T))) == [
        "ramp"
    ]


def test_noise_alone_has_settled():
    noisy = 30 + 0.05 * np.random.default_rng(0).standard_normal(len(T))
    assert kpis(T, noisy, 30.0)["settling time"] == 0.0


def test_what_lies_on_the_edge_of_the_band_is_within():
    """A sensor with steps of 0.1: 29.7 is within 0.3 of 30, although its float is not."""
    t, y = np.arange(0.0, 8.0), np.array([20.0, 27.0, 29.7, 29.7, 30.0, 29.7, 30.0, 30.0])
    assert kpis(t, y, 30.0)["settling time"] == 2.0


@pytest.mark.parametrize("end", [56.1, 56.2, 58.5, 58.6])
def test_an_oscillation_that_ends_within_the_band_has_not_settled(end):
    t = T[end > T]
    y = np.where(t < 1, 0.0, 1 + 0.1 * np.sin(2 * np.pi * (t - 1) / 4.8))
    assert kpis(t, y, np.where(t < 1, 0.0, 1.0))["settling time"] == np.inf


def test_who_leaves_the_band_once_and_stays_afterwards_has_settled():
    y = 1 + np.interp(T, [0, 2, 36, 37, 39, 40, 60], [-1, 0, 0.02, 0.04, 0.04, 0.02, 0.0])
    # A visit of 34 s ended; the last one of 20 s is longer than a tenth of 60 s.
    assert kpis(T, y, np.ones_like(T))["settling time"] == pytest.approx(39.5, abs=0.06)
