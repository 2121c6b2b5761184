import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefcal_agents.models.gaussian_process import GaussianProcess

RNG = np.random.default_rng(0)
SAMPLES = RNG.random((20, 3))
VALUES = np.sin(5 * SAMPLES[:, 0]) + SAMPLES[:, 1] ** 2
PROCESS = GaussianProcess.through(SAMPLES, VALUES)
coordinate = st.floats(0, 1)


def test_it_goes_through_the_values_and_is_sure_there():
    mean, deviation = PROCESS(SAMPLES)
    assert mean == pytest.approx(VALUES, abs=1e-3)
    assert np.all(deviation < 2e-3 * np.sqrt(PROCESS.variance))


def test_it_foretells_what_lies_between_better_than_the_mean_and_knows_how_well():
    others = RNG.random((300, 3))
    true = np.sin(5 * others[:, 0]) + others[:, 1] ** 2
    mean, deviation = PROCESS(others)
    assert np.std(mean - true) < 0.1 * np.std(true)
    assert np.mean(np.abs(mean - true) < 3 * deviation) > 0.9


def test_a_knob_that_does_not_matter_gets_the_greatest_length():
    assert PROCESS.lengths[0] < PROCESS.lengths[1] < PROCESS.lengths[2]
    assert PROCESS.lengths[2] > 5


def test_it_agrees_with_the_formula_written_out():
    # Rasmussen and Williams, equations 2.25, 2.26 and 4.17, with the mean of 2.43 and following.
    def kernel(a, b):
        r = np.linalg.norm((a[:, None] - b) / PROCESS.lengths, axis=2)
        return (1 + np.sqrt(5) * r + 5 / 3 * r**2) * np.exp(-np.sqrt(5) * r)

    inverse = np.linalg.inv(kernel(SAMPLES, SAMPLES) + 1e-8 * np.eye(20))
    mean = inverse.sum(axis=0) @ VALUES / inverse.sum()
    variance = (VALUES - mean) @ inverse @ (VALUES - mean) / 20
    z = RNG.random((5, 3))
    k = kernel(z, SAMPLES)
    left = variance * (1 + 1e-8 - np.sum((k @ inverse) * k, axis=1))
    found, deviation = PROCESS(z)
    assert found == pytest.approx(mean + k @ inverse @ (VALUES - mean), abs=1e-6)
    assert deviation == pytest.approx(np.sqrt(left), rel=1e-4)


@given(st.tuples(coordinate, coordinate, coordinate))
def test_slopes_agree_with_differences(point):
    point, steps = np.array(point), 1e-6 * np.eye(3)
    mean, deviation, of_mean, of_deviation = PROCESS.slopes(point)
    (one,), (two,) = PROCESS(point[None])
    assert (mean, deviation) == (pytest.approx(one), pytest.approx(two, rel=1e-6, abs=1e-9))
    if np.min(np.linalg.norm(SAMPLES - point, axis=1)) < 1e-3:
        return  # the deviation has a kink at a sample, but for the noise
    above, below = PROCESS(point + steps), PROCESS(point - steps)
    assert of_mean == pytest.approx((above[0] - below[0]) / 2e-6, rel=1e-3, abs=1e-5)
    assert of_deviation == pytest.approx((above[1] - below[1]) / 2e-6, rel=1e-3, abs=1e-5)


@pytest.mark.parametrize("count", [1, 2, 400])
def test_few_and_many_samples(count):
    samples = np.random.default_rng(1).random((count, 2))
    process = GaussianProcess.through(samples, samples[:, 0])
    mean, deviation = process(samples)
    assert mean == pytest.approx(samples[:, 0], abs=0.01)
    assert np.all(np.isfinite(deviation))
    assert np.all(deviation >= 0)


def test_samples_that_coincide_and_values_that_are_equal():
    process = GaussianProcess.through(np.full((5, 2), 0.3), np.zeros(5))
    mean, deviation = process(np.array([[0.3, 0.3], [0.9, 0.9]]))
    assert mean == pytest.approx([0, 0])
    assert np.all(np.isfinite(deviation))
