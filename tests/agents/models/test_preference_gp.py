"""A Gaussian process of which only comparisons are known."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

from prefcal_agents.history.lessons import Preferences
from prefcal_agents.models.preference_gp import PreferenceGP, _Known

RNG = np.random.default_rng(0)


def bowl(z):
    """Only the first two of its knobs matter."""
    return (z[:, 0] - 0.4) ** 2 + 2 * (z[:, 1] - 0.7) ** 2


def chain(samples, values):
    """Each sample compared with the best before it."""
    best, pairs = 0, []
    for k in range(1, len(samples)):
        pairs.append((k, best, int(np.sign(values[k] - values[best]))))
        best = k if values[k] < values[best] else best
    first, second, b = np.array(pairs).T
    return Preferences(samples, first, second, b, np.ones(len(b)))


SAMPLES = RNG.random((40, 3))
PREFERENCES = chain(SAMPLES, bowl(SAMPLES))


def test_it_keeps_the_answers_and_foretells_others():
    process = PreferenceGP.of(PREFERENCES)
    values = process(SAMPLES)
    gaps = values[PREFERENCES.first] - values[PREFERENCES.second]
    assert np.all(gaps * PREFERENCES.b > 0)
    others = RNG.random((400, 3))
    true, found = bowl(others), process(others)
    right = (true[:200] < true[200:]) == (found[:200] < found[200:])
    assert np.mean(right) > 0.85


def test_its_lowest_point_is_near_the_minimum_of_the_cost():
    process, others = PreferenceGP.of(PREFERENCES), RNG.random((4000, 3))
    lowest = others[np.argmin(process(others))]
    assert lowest[:2] == pytest.approx([0.4, 0.7], abs=0.1)


def test_a_knob_that_does_not_matter_gets_the_greatest_length():
    assert np.argmax(PreferenceGP.of(PREFERENCES).lengths) == 2


def test_the_evidence_is_the_probability_of_the_answers():
    # Three values: the orthant of a normal distribution, which scipy integrates.
    samples = np.array([[0.1], [0.4], [0.9]])
    preferences = Preferences(
        samples, np.array([1, 2]), np.array([0, 1]), np.array([-1, 1]), np.ones(2)
    )
    known = _Known.of(preferences, 1e-6)
    factor = known.factor(np.array([0.5]))[0]
    kernel, rows = factor @ factor.T, np.array([[1.0, -1.0, 0.0], [0.0, -1.0, 1.0]])
    true = multivariate_normal(np.zeros(2), rows @ kernel @ rows.T).cdf(np.zeros(2))
    assert known.belief(factor, None).evidence == pytest.approx(np.log(true), abs=5e-3)


@pytest.mark.parametrize("error_rate", [1e-6, 0.1])
def test_the_slope_of_the_evidence_agrees_with_differences(error_rate):
    known, lengths = _Known.of(PREFERENCES, error_rate), np.array([0.6, 0.5, 1.2])
    factor, u, slope = known.factor(lengths)
    found = -0.5 * np.einsum(
        "mN,jmN->j", known._pull(factor, known.belief(factor, None)) * slope, u
    )
    for knob in range(3):
        longer, shorter = lengths.copy(), lengths.copy()
        longer[knob] *= np.exp(0.01)
        shorter[knob] *= np.exp(-0.01)
        up, down = (
            known.belief(known.factor(each)[0], None).evidence for each in (longer, shorter)
        )
        # The search for the sites ends at a tolerance.
        assert found[knob] == pytest.approx((up - down) / 0.02, abs=0.05)


@given(st.tuples(*[st.floats(0, 1)] * 3))
def test_its_gradient_agrees_with_differences(point):
    process, point, steps = PROCESS, np.array(point), 1e-5 * np.eye(3)
    expected = (process(point + steps) - process(point - steps)) / 2e-5
    scale = process.spread
    assert process.gradient(point) / scale == pytest.approx(expected / scale, abs=2e-3)


PROCESS = PreferenceGP.of(PREFERENCES)


def test_the_process_of_the_last_samples_alone_when_there_are_many():
    samples = np.random.default_rng(3).random((180, 2))
    process = PreferenceGP.of(chain(samples, bowl(samples)))
    assert len(process.centres) == 100
    best = samples[np.argmin(bowl(samples))]
    assert any(np.array_equal(best, z) for z in process.centres)
    assert np.array_equal(process.centres[-1], samples[-1])


def test_one_answer_says_next_to_nothing_about_the_lengths():
    for n in (1, 4):
        samples = np.random.default_rng(n).random((2, n))
        process = PreferenceGP.of(chain(samples, samples[:, 0]))
        assert process.lengths == pytest.approx(np.full(n, 0.35 * np.sqrt(n)), rel=0.2)


def test_ties_are_left_out():
    b = PREFERENCES.b.copy()
    b[3:] = 0
    few = PreferenceGP.of(
        Preferences(SAMPLES, PREFERENCES.first, PREFERENCES.second, b, np.ones(len(b)))
    )
    assert len(few.centres) == 4


def test_a_wrong_answer_is_outvoted_where_answers_may_be_wrong():
    samples = np.linspace(0, 1, 9)[:, None]
    pairs = [(i, j) for i in range(9) for j in range(i)]
    first, second = np.array(pairs).T
    b = np.ones(len(pairs), dtype=np.int64)
    wrong = pairs.index((8, 4))
    b[wrong] = -1
    answers = Preferences(samples, first, second, b, np.ones(len(b)))
    assert np.all(np.diff(PreferenceGP.of(answers, 0.1)(samples)) > 0)
