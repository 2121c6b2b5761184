"""From the data set and the selection to Ĵ."""

from dataclasses import replace

import numpy as np

from prefcal_agents import GLISpSettings
from prefcal_agents.glisp.noise_test import NoiseTest
from prefcal_agents.glisp.selection import Dataset, Selection, train, trust
from prefcal_agents.models.rbf import Shape
from prefcal_env.preferences.answer import Answer
from prefcal_env.preferences.history import History
from support.histories import in_cube

SHAPE, WIDE = Shape(1.0, (1.0, 1.0)), Shape(0.5, (1.0, 1.0))
TRUSTED = Selection(SHAPE, None, is_noisy=False)
NOISY = Selection(SHAPE, NoiseTest(WIDE, 5.0), is_noisy=True)
SETTINGS = GLISpSettings()


def cost(z):
    return float(np.sum((z - [0.3, 0.6]) ** 2))


def data_of(count=16, wrong=()):
    """Return random samples, each compared with the latest two."""
    history, costs = History(), []
    for k, z in enumerate(np.random.default_rng(2).random((count, 2))):
        costs.append(cost(z))
        answers = [int(np.sign(costs[k] - costs[j])) for j in range(max(k - 2, 0), k)] or [None]
        answers[-1] = -answers[-1] if k in wrong else answers[-1]
        history = history.with_pending(in_cube(z))
        history = history.with_answer(Answer(answers[-1]), k - 1 if k else None)
        if len(answers) > 1:
            history = history.with_follow_up(Answer(answers[0]), k, k - 2)
    return Dataset.of(history)


def trained(data, selection, **settings):
    return train(data, selection, replace(SETTINGS, **settings))


def agrees(surrogate, preferences):
    """Return for each answer whether Ĵ agrees with it."""
    values = surrogate(preferences.samples)
    return preferences.b * (values[preferences.first] - values[preferences.second]) > 0


def test_answers_that_are_trusted_are_all_kept():
    data = data_of()
    surrogate = trained(data, TRUSTED)
    assert surrogate.shape == SHAPE
    assert np.all(agrees(surrogate, data.preferences))


def test_if_answers_may_be_wrong_those_that_others_contradict_are_not_kept():
    right, data = data_of(), data_of(wrong=(7, 12))
    surrogate = trained(data, NOISY)
    assert surrogate.shape == WIDE  # the shape of the noise test
    assert not np.all(agrees(surrogate, data.preferences))
    assert np.mean(agrees(surrogate, right.preferences)) > 0.9


def test_the_error_rate_counts_only_if_answers_may_be_wrong():
    data = data_of(wrong=(7, 12))

    def changes(selection):
        low, high = (trained(data, selection, error_rate=e) for e in (0.01, 0.3))
        return not np.array_equal(low.beta, high.beta)

    assert changes(NOISY)
    assert not changes(TRUSTED)


def test_the_posterior_has_one_coefficient_for_each_sample():
    data = data_of(wrong=(7,))
    assert trust(data, NOISY, 0.1).mean.shape == (16,)
    assert trust(data, NOISY, 0.1).wrong.max() > 0.1 > trust(data, NOISY, 0.001).wrong.min()
