"""What is learned from answers, scores and KPIs: RBF, eq. QP-pref, Gaussian process, interpolant."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.interpolate import RBFInterpolator
from scipy.optimize import check_grad
from scipy.stats import multivariate_normal

from prefcal_agents.baselines import POSITIVE_DEFINITE, best_interpolant, interpolate
from prefcal_agents.glisp.fits import rows_of
from prefcal_agents.learned_cost import Outcomes
from prefcal_agents.lessons import Preferences, normalize
from prefcal_agents.surrogate import (
    RADIAL_FUNCTIONS,
    Constraints,
    ExpectationPropagation,
    Learning,
    PreferenceGP,
    Shape,
    Surrogate,
    Validation,
    _StrictAnswers,
    choose_epsilon,
    fit,
    margins,
    matern,
    nearest,
    rescale_knob,
    squared_distances,
    squares,
)
from prefcal_env.preferences.history import History
from support.histories import studied


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("inverse_quadratic", 1 / (1 + 0.25)),
        ("gaussian", np.exp(-0.25)),
        ("thin_plate_spline", 0.25 * np.log(0.5)),
    ],
)
def test_values_at_one_half_are_those_of_the_formulas_after_eq_rbf(name, value):
    epsilon_d = 0.5
    assert RADIAL_FUNCTIONS[name].value(np.array(epsilon_d**2)) == pytest.approx(value)


@pytest.mark.parametrize("name", sorted(RADIAL_FUNCTIONS))
@given(u=st.floats(1e-3, 50))
def test_slopes_agree_with_differences(name, u):
    f, h = RADIAL_FUNCTIONS[name], 1e-6 * u
    difference = (f.value(np.array(u + h)) - f.value(np.array(u - h))) / (2 * h)
    assert f.slope(np.array(u)) == pytest.approx(difference, rel=1e-5, abs=1e-8)


@pytest.mark.parametrize("name", sorted(RADIAL_FUNCTIONS))
def test_values_and_slopes_are_finite_on_a_center(name):
    f = RADIAL_FUNCTIONS[name]
    assert np.isfinite(f.value(np.zeros(1))).all()
    assert np.isfinite(f.slope(np.zeros(1))).all()


def test_squared_distances_by_hand():
    d = squared_distances(np.array([[0.0, 0.0], [1.0, 2.0]]), np.array([[3.0, 4.0]]))
    assert d.tolist() == [[25.0], [8.0]]


def test_squared_distances_of_close_points_keep_their_digits():
    a = np.array([[0.7, 0.3]])
    assert squared_distances(a, a + 1e-9)[0, 0] == pytest.approx(2e-18, rel=1e-6)


def test_eq_rbf_by_hand_with_the_squared_distance():
    # Distance 2 from the center: d = 4, ε d = 2, φ = 1 / (1 + 2²).
    surrogate = Surrogate(np.array([[0.0, 0.0]]), np.array([5.0]), Shape(0.5, (1.0, 1.0)))
    assert surrogate(np.array([[2.0, 0.0]])) == pytest.approx([1.0])


def test_a_knob_with_scale_two_counts_as_if_its_range_were_twice_as_wide():
    wide = Shape(0.7, (2.0, 0.5), "gaussian")
    plain = Shape(0.7, (1.0, 1.0), "gaussian")
    a, b = np.random.default_rng(0).random((2, 4, 2))
    assert wide.basis(a, b) == pytest.approx(plain.basis(a * [2, 0.5], b * [2, 0.5]))


def test_the_spread_is_the_range_over_the_samples():
    centers = np.array([[0.0], [1.0]])
    assert Surrogate(centers, np.array([2.0, 0.0]), Shape(1.0, (1.0,))).spread == 1.0


def comparisons(n_samples=9, count=10, seed=0, ties=True, weights=None):
    """Random comparisons, not consistent with any function if there are many."""
    rng = np.random.default_rng(seed)
    pairs = np.array([rng.choice(n_samples, 2, replace=False) for _ in range(count)])
    return Preferences(
        samples=rng.random((n_samples, 2)),
        first=pairs[:, 0],
        second=pairs[:, 1],
        b=rng.choice([-1, 0, 1] if ties else [-1, 1], count),
        weights=np.ones(count) if weights is None else weights,
    )


def basis(preferences, epsilon=1.5):
    return Shape(epsilon, (1.0, 1.0)).basis(preferences.samples, preferences.samples)


def weights_of(preferences, learning):
    phi = basis(preferences)
    constraints = Constraints.of(preferences, phi, margins(preferences, learning.margin_power))
    return fit(constraints, learning)


def cost(beta, preferences, learning):
    """The objective of eq. QP-pref, with each slack as small as eq. RBF-pref allows."""
    values = basis(preferences) @ beta
    gap = values[preferences.first] - values[preferences.second]
    violation = np.where(
        preferences.b == 0, np.abs(gap) - learning.sigma, learning.sigma - preferences.b * gap
    )
    slack = np.maximum(violation, 0)
    return preferences.weights @ slack + learning.lam / 2 * beta @ beta


@given(
    seed=st.integers(0, 10**6),
    count=st.integers(1, 20),
    sigma=st.sampled_from([1e-6, 1e-2, 1.0]),
    lam_sigma=st.sampled_from([1e-6, 1e-3, 1.0]),
)
@settings(max_examples=25, deadline=None)
def test_no_other_weights_cost_less_in_eq_qp_pref(seed, count, sigma, lam_sigma):
    rng = np.random.default_rng(seed)
    preferences = comparisons(count=count, seed=seed, weights=rng.uniform(0.5, 2, count))
    learning = Learning(sigma=sigma, lam=lam_sigma / sigma)
    beta = weights_of(preferences, learning)
    least = cost(beta, preferences, learning)
    size = np.linalg.norm(beta) + sigma
    for step in (1e-3, 1e-2, 0.1, 1.0):
        for direction in rng.standard_normal((20, len(beta))):
            other = cost(beta + step * size * direction, preferences, learning)
            assert other >= least - 1e-6 * least - 1e-9 * sigma * count


def test_consistent_preferences_are_reproduced_with_the_paper_s_sigma():
    rng = np.random.default_rng(1)
    samples = rng.random((12, 2))
    values = np.sum((samples - 0.4) ** 2, axis=1)
    values[7] = values[3]
    first, second = np.arange(1, 12), np.arange(11)
    first, second = np.append(first, 7), np.append(second, 3)
    b = np.sign(values[first] - values[second]).astype(int)
    preferences = Preferences(samples, first, second, b, np.ones(12))
    beta = weights_of(preferences, Learning(sigma=1e-6, lam=1.0))
    learned = Surrogate(samples, beta, Shape(1.5, (1.0, 1.0)))(samples)
    gap = (learned[first] - learned[second]) / 1e-6
    strict = b != 0
    assert np.all(b[strict] * gap[strict] >= 1 - 1e-4)
    assert np.all(np.abs(gap[~strict]) <= 1 + 1e-4)


def test_sigma_only_scales_the_weights_if_lambda_sigma_stays():
    preferences = comparisons(count=8, seed=2)
    small = weights_of(preferences, Learning(sigma=1e-6, lam=1.0))
    large = weights_of(preferences, Learning(sigma=1.0, lam=1e-6))
    assert small * 1e6 == pytest.approx(large, rel=1e-6, abs=1e-9)


def test_of_two_contradicting_answers_the_stronger_one_is_believed():
    samples = np.array([[0.0, 0.0], [1.0, 1.0]])
    twice = np.array([0, 0])
    for weights, sign in (((1.0, 3.0), 1), ((3.0, 1.0), -1)):
        preferences = Preferences(samples, twice, twice + 1, np.array([-1, 1]), np.array(weights))
        beta = weights_of(preferences, Learning(sigma=1e-6, lam=1.0))
        learned = Surrogate(samples, beta, Shape(1.5, (1.0, 1.0)))(samples)
        assert np.sign(learned[0] - learned[1]) == sign


def test_nothing_known_and_nothing_but_ties_give_a_flat_surrogate():
    nothing = comparisons(count=1).subset(np.array([], dtype=int))
    assert not weights_of(nothing, Learning()).any()
    preferences = comparisons(count=6)
    ties = Preferences(
        preferences.samples, preferences.first, preferences.second, np.zeros(6, int), np.ones(6)
    )
    assert weights_of(ties, Learning()) == pytest.approx(np.zeros(9), abs=1e-9)


def test_margins_are_sigma_for_all_with_power_zero_and_grow_with_distance_otherwise():
    samples = np.array([[0.0, 0.0], [0.03, 0.03], [0.3, 0.3], [1.0, 1.0]])
    preferences = Preferences(samples, np.array([1, 2, 3]), np.zeros(3, int), np.ones(3, int), np.ones(3))
    assert margins(preferences, 0.0).tolist() == [1, 1, 1]
    assert margins(preferences, 1.0) == pytest.approx([0.1, 1, 1])
    assert margins(preferences, 2.0) == pytest.approx([0.01, 1, 1])


def test_samples_that_phi_cannot_tell_apart_do_no_harm():
    samples = np.array([[0.5, 0.5], [0.5, 0.5 + 1e-13], [0.1, 0.9]])
    preferences = Preferences(samples, np.array([1, 2]), np.array([0, 0]), np.array([-1, 1]), np.ones(2))
    assert np.isfinite(weights_of(preferences, Learning())).all()


LEARNING = Learning()
CANDIDATES = (0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0)


def study(latent, n=2, count=40, seed=0):
    """`count` comparisons, each with the best one before."""
    rng = np.random.default_rng(seed)
    samples = rng.random((count + 1, n))
    values = np.array([latent(z) for z in samples])
    first = np.arange(1, count + 1)
    second = np.array([int(np.argmin(values[:i])) for i in first])
    b = np.sign(values[first] - values[second]).astype(int)
    # And with the one before, so that not only the best one is known well.
    before = first - 1
    b_before = np.sign(values[first] - values[before]).astype(int)
    return Preferences(
        samples,
        np.concatenate([first, first]),
        np.concatenate([second, before]),
        np.concatenate([b, b_before]),
        np.ones(2 * count),
    )


def validation(preferences, seed=0):
    return Validation.deal(preferences, LEARNING, np.random.default_rng(seed))


def judge(checked):
    """What tries ε next to that of a shape."""
    return lambda shape: choose_epsilon(checked, shape, nearest(CANDIDATES, shape.epsilon, 1))


def test_every_comparison_is_left_out_exactly_once_in_slices_of_like_size():
    slices = validation(study(lambda z: z[0], count=10)).slices
    assert slices.sum(axis=0).tolist() == [1] * 20
    assert sorted(slices.sum(axis=1)) == [6, 7, 7]


def test_a_smooth_function_asks_for_a_small_epsilon_and_a_rugged_one_for_a_larger():
    smooth, _ = choose_epsilon(
        validation(study(lambda z: np.sum((z - 0.4) ** 2))), Shape(1.0, (1.0, 1.0)), CANDIDATES
    )
    rugged, _ = choose_epsilon(
        validation(study(lambda z: np.sin(14 * z[0]), n=1, count=60)), Shape(1.0, (1.0,)), CANDIDATES
    )
    assert smooth.epsilon < 5 < rugged.epsilon


def test_the_chosen_epsilon_predicts_most_of_what_was_left_out():
    known = study(lambda z: np.sum((z - 0.4) ** 2))
    _, right = choose_epsilon(validation(known), Shape(1.0, (1.0, 1.0)), CANDIDATES)
    assert right > 0.85 * len(known)


def test_candidates_that_are_equally_good_give_the_middle_one():
    known = study(lambda z: z[0], n=1, count=3)
    everything_right, _ = choose_epsilon(validation(known), Shape(1.0, (1.0,)), (0.9, 1.0, 1.1))
    assert everything_right.epsilon in (0.9, 1.0, 1.1)
    alike = validation(known.subset(np.array([0, 1, 2])))
    at = (0.9, 1.0, 1.1)
    scores = alike.reproduce(Shape(1.0, (1.0,), "gaussian"), at)
    assert len(set(scores)) == 1
    assert choose_epsilon(alike, Shape(1.0, (1.0,), "gaussian"), at)[0].epsilon == 1.0


def test_scales_never_differ_by_more_than_the_widest_ratio():
    known = study(lambda z: np.sin(9 * z[1]), count=30)
    shape = Shape(1.0, (1.0, 1.0))
    for round_ in range(12):
        shape = rescale_knob(shape, -2, 1, judge(validation(known, seed=round_)))
        assert max(shape.scales) <= 16 * min(shape.scales)


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
    known = _StrictAnswers.of(preferences, 1e-6)
    factor = known.factor(np.array([0.5]))[0]
    kernel, rows = factor @ factor.T, np.array([[1.0, -1.0, 0.0], [0.0, -1.0, 1.0]])
    true = multivariate_normal(np.zeros(2), rows @ kernel @ rows.T).cdf(np.zeros(2))
    assert known.posterior(factor, None).evidence == pytest.approx(np.log(true), abs=5e-3)


@pytest.mark.parametrize("error_rate", [1e-6, 0.1])
def test_the_slope_of_the_evidence_agrees_with_differences(error_rate):
    known, lengths = _StrictAnswers.of(PREFERENCES, error_rate), np.array([0.6, 0.5, 1.2])
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


RNG = np.random.default_rng(7)
SAMPLES = RNG.uniform(-1, 1, (12, 3))
VALUES = np.sin(SAMPLES @ [1.0, 2.0, -1.0])


@pytest.mark.parametrize("rbf", POSITIVE_DEFINITE)
def test_it_goes_through_the_values_and_has_the_right_slope(rbf):
    interpolant, _ = interpolate(SAMPLES, VALUES, 0.8, rbf)
    assert interpolant(SAMPLES) == pytest.approx(VALUES, abs=1e-6)
    z = np.array([0.3, -0.2, 0.7])
    slope = check_grad(lambda x: interpolant(x[None])[0], interpolant.gradient, z)
    assert slope < 1e-5 * max(1.0, np.abs(interpolant.beta).max())


def test_it_agrees_with_scipy():
    interpolant, _ = interpolate(SAMPLES, VALUES, 1.3, "inverse_quadratic")
    reference = RBFInterpolator(
        SAMPLES, VALUES - VALUES.mean(), kernel="inverse_quadratic", epsilon=1.3, degree=-1
    )
    z = RNG.uniform(-1, 1, (20, 3))
    assert interpolant(z) == pytest.approx(reference(z) + VALUES.mean(), abs=1e-6)


def test_the_leave_one_out_error_is_what_leaving_one_out_gives():
    # The mean stays that of all values, as in the formula.
    offset, errors = VALUES.mean(), []
    _, error = interpolate(SAMPLES, VALUES, 1.0, "inverse_quadratic")
    for k in range(len(SAMPLES)):
        rest = np.arange(len(SAMPLES)) != k
        reference = RBFInterpolator(
            SAMPLES[rest], VALUES[rest] - offset, kernel="inverse_quadratic", epsilon=1.0, degree=-1
        )
        errors.append(reference(SAMPLES[k : k + 1])[0] + offset - VALUES[k])
    assert error == pytest.approx(np.sqrt(np.mean(np.square(errors))), rel=1e-4)


def test_the_epsilon_that_predicts_best_is_chosen():
    narrow = best_interpolant(SAMPLES, VALUES, (0.5, 50.0), "inverse_quadratic")
    assert narrow.epsilon == 0.5


def test_two_samples_at_one_place_break_nothing():
    samples = np.vstack([SAMPLES, SAMPLES[:1]])
    values = np.append(VALUES, VALUES[0] + 1e-3)
    interpolant, _ = interpolate(samples, values, 1.0, "gaussian")
    assert np.isfinite(interpolant(samples)).all()


@given(st.lists(st.floats(-1e300, 1e300), min_size=1, max_size=30), st.floats(0.01, 100.0))
def test_normalized_scores_keep_their_order(values, ceiling):
    values = np.array(values)
    shares = normalize(values, ceiling)
    assert ((shares >= 0) & (shares <= 1)).all()
    assert shares[np.argmin(values)] == 0
    order = np.argsort(values, kind="stable")
    assert (np.diff(shares[order]) >= 0).all()


def test_an_interrupted_run_does_not_flatten_the_others():
    values = np.array([0.7, 0.8, 0.9, 1.0, 1000.5, 1000.9])
    shares = normalize(values, 2.0)
    assert shares[3] > 0.3
    assert shares[4] == shares[5] == 1.0
    assert normalize(values, 1e9)[3] < 1e-3


def history_of(columns):
    """A history whose samples have these KPIs: name to values."""
    rows = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
    known = [{name: v for name, v in row.items() if v is not None} for row in rows]
    points = np.random.default_rng(0).random((len(rows), 2))
    answers, rivals = [None, *[1] * len(rows)], [None, *[0] * len(rows)]
    return studied(points, answers=answers, rivals=rivals, kpis=known)


def test_shares_run_from_the_best_to_the_worst_and_one_lost_run_does_not_flatten_them():
    outcomes = Outcomes.of(history_of({"k": [1.0, 2.0, 3.0, 1e6]}))
    # Median 2.5: all above 2.5 + 2 * 1.5 = 5.5 counts as 5.5.
    assert outcomes.columns[:, 0] == pytest.approx([0, 1 / 4.5, 2 / 4.5, 1])
    assert outcomes.ranges[0] == pytest.approx((1.0, 5.5))


def test_what_cannot_teach_is_left_out():
    columns = {"same": [3.0] * 5, "rare": [1.0, 2.0, None, None, None], "nan": [np.nan] * 5}
    assert len(Outcomes.of(history_of(columns))) == 0
    assert len(Outcomes.of(History())) == 0
    assert Outcomes.of(history_of({**columns, "good": [1.0, 2.0, 3.0, 4.0, 5.0]})).names == ("good",)


KPI = st.none() | st.floats(width=64)


@given(st.lists(st.tuples(KPI, KPI), min_size=1, max_size=8))
@example([(1e300, -1e300), (-1e300, 1e300), (0.0, 0.0), (5e-324, 1.0)])
@example([(np.inf, -np.inf), (-np.inf, np.inf), (np.inf, 0.0)])
@example([(1.7e308, 0.0), (-1.7e308, 1.0), (0.0, 2.0)])
def test_whatever_the_values_shares_are_between_0_and_1(rows):
    first, second = zip(*rows, strict=True)
    history = history_of({"k": first, "l": second})
    outcomes = Outcomes.of(history)
    assert outcomes.columns.shape == (len(rows), len(outcomes))
    assert ((outcomes.columns >= 0) & (outcomes.columns <= 1)).all()
    for k, (name, (best, worst)) in enumerate(zip(outcomes.names, outcomes.ranges, strict=True)):
        values = np.array([v if v is not None else np.nan for v in (first if name == "k" else second)])
        assert best < worst
        assert (outcomes.columns[values == np.inf, k] == 1.0).all()
