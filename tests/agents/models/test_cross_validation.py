import numpy as np
import pytest

from prefcal_agents.lessons import Preferences
from prefcal_agents.surrogate import Learning, Shape, Validation, choose_epsilon, nearest, rescale_knob

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
    scores = alike.reproduced(Shape(1.0, (1.0,), "gaussian"), at)
    assert len(set(scores)) == 1
    assert choose_epsilon(alike, Shape(1.0, (1.0,), "gaussian"), at)[0].epsilon == 1.0


def test_a_knob_that_hardly_matters_comes_to_count_less():
    known = study(lambda z: np.sin(6 * z[1]) + 0.05 * z[0], count=40)
    shape = Shape(1.0, (1.0, 1.0))
    for round_ in range(8):
        checked = validation(known, seed=round_)
        shape, score = choose_epsilon(checked, shape, CANDIDATES)
        shape = rescale_knob(shape, score, round_ % 2, judge(checked))
    assert shape.scales[1] > 2 * shape.scales[0]
    assert np.prod(shape.scales) == pytest.approx(1.0)


def test_scales_never_differ_by_more_than_the_widest_ratio():
    known = study(lambda z: np.sin(9 * z[1]), count=30)
    shape = Shape(1.0, (1.0, 1.0))
    for round_ in range(12):
        shape = rescale_knob(shape, -2, 1, judge(validation(known, seed=round_)))
        assert max(shape.scales) <= 16 * min(shape.scales)
