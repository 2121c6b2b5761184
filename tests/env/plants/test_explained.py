"""Models of a record: their responses are exact, and their numbers are those of the transfer function."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import signal

from prefcal_env.plants.explained import FAMILIES, Model, Scaled, respond

T = np.linspace(0, 10, 101)


def input_of(seed):
    """An input that moves at a few instants."""
    rng = np.random.default_rng(seed)
    return np.repeat(rng.normal(size=6), 17)[: len(T)]


def by_scipy(model, u, fine=10):
    """The response by scipy's own sampling on a finer grid, later by whole steps of it."""
    h = T[1] / fine
    late = round(model.delay / h)
    num, den, _ = signal.cont2discrete((model.num, model.den), h, "zoh")
    held = np.concatenate([np.zeros(late), np.repeat(u, fine)])[: len(u) * fine]
    return signal.lfilter(np.ravel(num), den, held)[::fine]


@pytest.mark.parametrize("family", FAMILIES, ids=lambda family: family.name)
@given(st.integers(0, 40), st.integers(0, 2**32 - 1))
def test_every_family_responds_as_scipy_says(family, late, seed):
    rng = np.random.default_rng(seed)
    low, high = family.box(0.5)
    # Slower than the finer grid, on which scipy's polynomials lose their last digits.
    shape = np.clip(low + rng.random(len(low)) * (high - low), np.log(0.1), None)
    num = tuple(rng.normal(size=family.terms).tolist())
    model = Model(family.name, num, tuple(family.den(shape).tolist()), late * T[1] / 10)
    expected = by_scipy(model, input_of(seed))
    assert respond(model, T[1], input_of(seed)) == pytest.approx(expected, abs=1e-6 * np.ptp(expected) + 1e-9)


def test_dead_time_within_a_sample_shifts_the_response_of_a_lag_exactly():
    late = 0.123
    made = Model("a lag", (2.0,), (3.0, 1.0), late).step(T)
    assert made == pytest.approx(np.where(late < T, 2 * (1 - np.exp(-np.maximum(T - late, 0) / 3)), 0.0))


def test_dead_time_beyond_the_record_leaves_no_response():
    assert not respond(Model("a lag", (2.0,), (3.0, 1.0), 11.0), T[1], np.ones(len(T))).any()


def test_the_numbers_of_a_model_are_those_of_its_transfer_function():
    model = Model("two lags and a zero", (-4.0, 2.0), (6.0, 5.0, 1.0), 0.7)
    assert model.numbers == pytest.approx(
        {
            "gain": 2.0,
            "time constant 1": 3.0,
            "time constant 2": 2.0,
            "zero's time constant": -2.0,
            "dead time": 0.7,
        }
    )


def test_an_integrator_has_a_rate_and_lags_and_an_oscillation_a_damping():
    swinging = Model("an integrator and two lags", (0.3,), (4.0, 1.2, 1.0, 0.0), 0.0).numbers
    assert swinging == pytest.approx({"rate": 0.3, "1/ω": 2.0, "damping": 0.3, "dead time": 0.0})
    lagging = Model("an integrator and two lags", (0.3,), (6.0, 5.0, 1.0, 0.0), 0.0).numbers
    assert lagging == pytest.approx({"rate": 0.3, "lag 1": 3.0, "lag 2": 2.0, "dead time": 0.0})


def test_the_density_is_highest_for_the_family_and_shape_that_made_the_record():
    u = np.where(np.arange(400) < 40, 0.0, 1.0)
    lag = FAMILIES[0]
    true = np.array([np.log(0.1), 0.05])
    noise = 0.01 * np.random.default_rng(1).standard_normal(400)
    y = respond(Model(lag.name, (1.0,), tuple(lag.den(true)), 0.05), 1 / 399, u) + noise
    record = Scaled(1 / 399, u, y - y.mean(), 0.8)
    best = record.density(lag, true)
    assert best > record.density(lag, true + np.array([0.3, 0.0]))
    assert best > record.density(lag, true + np.array([0.0, 0.05]))
    assert record.density(lag, np.array([0.0, -0.01])) == -np.inf


@pytest.mark.parametrize("drift", [0.0, 0.02, 0.1])
def test_drift_and_gain_are_told_apart_by_the_rows_before_the_step(drift):
    u = np.where(np.arange(400) < 40, 0.0, 1.0)
    lag, shape = FAMILIES[0], np.array([np.log(0.05), 0.05])
    noise = 0.01 * np.random.default_rng(1).standard_normal(400)
    y = respond(Model(lag.name, (1.0,), tuple(lag.den(shape)), 0.05), 1 / 399, u) + noise
    moved = y + drift * np.linspace(-0.5, 0.5, 400)
    found = Scaled(1 / 399, u, moved - moved.mean(), 0.8, variance=1e-4).explained(lag, shape)
    gain, _, slope = found.mean
    # Of each, the deviation given the record: gain and drift together move the same rows.
    of_gain, _, of_slope = 0.01 * np.sqrt(np.linalg.inv(found.root @ found.root.T).diagonal())
    assert of_gain < 0.005
    assert of_slope < 0.005
    assert abs(gain - 1.0) < 3 * of_gain
    assert abs(slope - drift) < 3 * of_slope
