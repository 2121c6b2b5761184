import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

from prefcal_agents.glisp.fits import rows_of
from prefcal_agents.lessons import Preferences
from prefcal_agents.surrogate import (
    Constraints,
    ExpectationPropagation,
    PreferenceGP,
    Shape,
    _Known,
    matern,
    squares,
)

coordinate = st.floats(0, 1)


@given(st.lists(st.tuples(coordinate, coordinate), min_size=2, max_size=5))
def test_the_kernel_agrees_with_the_formula_written_out(points):
    # Rasmussen and Williams, equation 4.17.
    z = np.array(points)
    kernel, slope = matern(squares(z, z) / 0.3**2)
    r = np.linalg.norm((z[:, None] - z) / 0.3, axis=2)
    assert kernel == pytest.approx((1 + np.sqrt(5) * r + 5 / 3 * r**2) * np.exp(-np.sqrt(5) * r))
    above, below = (matern(squares(z, z) / 0.3**2 + step)[0] for step in (1e-6, 0.0))
    assert slope / 2 * 2e-6 == pytest.approx(above - below, abs=1e-9)  # twice, for two knobs


SHAPE = Shape(1.0, (1.0, 1.0))


def compared(flipped, *, seed=0, count=60):
    """Return `count` comparisons of 30 samples of a bowl; the answers of `flipped` are wrong."""
    rng = np.random.default_rng(seed)
    samples = rng.random((30, 2))
    cost = np.sum((samples - 0.4) ** 2, axis=1)
    pairs = np.array([rng.choice(30, 2, replace=False) for _ in range(count)])
    b = np.sign(cost[pairs[:, 0]] - cost[pairs[:, 1]]).astype(np.int64)
    b[list(flipped)] *= -1
    return Preferences(samples, pairs[:, 0], pairs[:, 1], b, np.ones(count)), cost


def test_one_answer_alone_is_believed_with_the_probability_of_the_gaussian_integral():
    # One row, standard normal prior: the mean of a half-normal is √(2/π), and (1 - 2e) of it where
    # the other half has a chance of e.
    rows = Constraints(np.array([[2.0, 0.0]]), np.ones(1), np.ones(1), np.zeros(1, dtype=np.int64))
    for e in (0.0, 0.1, 0.3):
        posterior = ExpectationPropagation.of(rows, e)
        assert posterior.mean == pytest.approx([(1 - 2 * e) * np.sqrt(2 / np.pi), 0.0], abs=1e-2)
        assert posterior.predicted == pytest.approx(np.log(0.5))
        assert posterior.wrong == pytest.approx([e])


def test_the_samples_are_ordered_as_the_right_answers_say_and_mistakes_are_pointed_out():
    flipped = {3, 17, 31, 40, 52, 58}
    preferences, cost = compared(flipped)
    posterior = ExpectationPropagation.of(rows_of(preferences, SHAPE), 0.1)
    values = SHAPE.basis(preferences.samples, preferences.samples) @ posterior.mean
    assert np.corrcoef(np.argsort(np.argsort(values)), np.argsort(np.argsort(cost)))[0, 1] > 0.95
    suspects = set(np.flatnonzero(posterior.wrong > 0.5).tolist())
    assert len(suspects & flipped) >= 4
    assert len(suspects - flipped) <= 1


def test_ties_teach_nothing_and_without_a_strict_preference_the_prior_stays():
    preferences, _ = compared(set(), count=5)
    ties = Preferences(
        preferences.samples, preferences.first, preferences.second, 0 * preferences.b, preferences.weights
    )
    posterior = ExpectationPropagation.of(rows_of(ties, SHAPE), 0.1)
    assert not posterior.mean.any()
    assert posterior.predicted == 0


CHANCE = np.random.default_rng(0)


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


POINTS = CHANCE.random((40, 3))
PREFERENCES = chain(POINTS, bowl(POINTS))


def test_it_keeps_the_answers_and_predicts_others():
    process = PreferenceGP.of(PREFERENCES)
    values = process(POINTS)
    gaps = values[PREFERENCES.first] - values[PREFERENCES.second]
    assert np.all(gaps * PREFERENCES.b > 0)
    others = CHANCE.random((400, 3))
    true, found = bowl(others), process(others)
    right = (true[:200] < true[200:]) == (found[:200] < found[200:])
    assert np.mean(right) > 0.85


def test_by_comparisons_too_a_knob_that_does_not_matter_gets_the_greatest_length():
    assert np.argmax(PreferenceGP.of(PREFERENCES).lengths) == 2


def test_the_evidence_is_the_probability_of_the_answers():
    # Three values: the orthant of a normal distribution, which scipy integrates.
    samples = np.array([[0.1], [0.4], [0.9]])
    preferences = Preferences(samples, np.array([1, 2]), np.array([0, 1]), np.array([-1, 1]), np.ones(2))
    known = _Known.of(preferences, 1e-6)
    factor = known.factor(np.array([0.5]))[0]
    kernel, rows = factor @ factor.T, np.array([[1.0, -1.0, 0.0], [0.0, -1.0, 1.0]])
    true = multivariate_normal(np.zeros(2), rows @ kernel @ rows.T).cdf(np.zeros(2))
    assert known.posterior(factor, None).evidence == pytest.approx(np.log(true), abs=5e-3)


@pytest.mark.parametrize("error_rate", [1e-6, 0.1])
def test_the_slope_of_the_evidence_agrees_with_differences(error_rate):
    known, lengths = _Known.of(PREFERENCES, error_rate), np.array([0.6, 0.5, 1.2])
    factor, u, slope = known.factor(lengths)
    found = -0.5 * np.einsum("mN,jmN->j", known._pull(factor, known.posterior(factor, None)) * slope, u)
    for knob in range(3):
        longer, shorter = lengths.copy(), lengths.copy()
        longer[knob] *= np.exp(0.01)
        shorter[knob] *= np.exp(-0.01)
        up, down = (known.posterior(known.factor(each)[0], None).evidence for each in (longer, shorter))
        # The search for the sites ends at a tolerance.
        assert found[knob] == pytest.approx((up - down) / 0.02, abs=0.05)


BY_COMPARISONS = PreferenceGP.of(PREFERENCES)


@given(st.tuples(*[st.floats(0, 1)] * 3))
def test_its_gradient_agrees_with_differences(point):
    process, point, steps = BY_COMPARISONS, np.array(point), 1e-5 * np.eye(3)
    expected = (process(point + steps) - process(point - steps)) / 2e-5
    scale = process.spread
    value, slope = process.value_and_gradient(point)
    assert value == pytest.approx(process(point[None])[0])
    assert slope / scale == pytest.approx(expected / scale, abs=2e-3)


def test_the_process_of_the_last_samples_alone_when_there_are_many():
    samples = np.random.default_rng(3).random((180, 2))
    process = PreferenceGP.of(chain(samples, bowl(samples)))
    assert len(process.centers) == 100
    best = samples[np.argmin(bowl(samples))]
    assert any(np.array_equal(best, z) for z in process.centers)
    assert np.array_equal(process.centers[-1], samples[-1])


def test_one_answer_says_next_to_nothing_about_the_lengths():
    for n in (1, 4):
        samples = np.random.default_rng(n).random((2, n))
        process = PreferenceGP.of(chain(samples, samples[:, 0]))
        assert process.lengths == pytest.approx(np.full(n, 0.35 * np.sqrt(n)), rel=0.2)


def test_ties_are_left_out():
    b = PREFERENCES.b.copy()
    b[3:] = 0
    few = PreferenceGP.of(Preferences(POINTS, PREFERENCES.first, PREFERENCES.second, b, np.ones(len(b))))
    assert len(few.centers) == 4


def test_a_wrong_answer_is_outvoted_where_answers_may_be_wrong():
    samples = np.linspace(0, 1, 9)[:, None]
    pairs = [(i, j) for i in range(9) for j in range(i)]
    first, second = np.array(pairs).T
    b = np.ones(len(pairs), dtype=np.int64)
    wrong = pairs.index((8, 4))
    b[wrong] = -1
    answers = Preferences(samples, first, second, b, np.ones(len(b)))
    assert np.all(np.diff(PreferenceGP.of(answers, 0.1)(samples)) > 0)
