"""GLIS finds minima, in few experiments, and is not fooled by an interrupted run."""

import numpy as np
import pytest

from prefcal_agents import GLIS
from prefcal_agents.baselines import GLISSettings
from prefcal_env.errors import KnobError, SettingsError
from support.latent import BRANIN, CAMEL, HARTMAN3


def minimize(function, seed, n_max=30, score=None, **options):
    agent = GLIS(function.space, n_max=n_max, seed=seed, **options)
    score = score or function
    while not agent.done:
        query = agent.ask()
        agent.tell(query, score(query.challenger.theta))
    return agent


@pytest.mark.parametrize(("function", "gap"), [(CAMEL, 1e-3), (HARTMAN3, 0.1)], ids=["camel", "hartman3"])
def test_it_comes_near_the_minimum_in_30_experiments(function, gap):
    gaps = [function.gap(minimize(function, seed).best) for seed in range(3)]
    assert np.median(gaps) < gap


def test_an_interrupted_run_that_costs_a_thousand_does_not_blind_it():
    def score(theta):
        return 1000.5 if theta[0] < -2 else BRANIN(theta)

    gaps = [BRANIN.gap(minimize(BRANIN, seed, score=score).best) for seed in range(3)]
    blind = GLISSettings(ceiling=1e9)
    without = [BRANIN.gap(minimize(BRANIN, seed, score=score, settings=blind).best) for seed in range(3)]
    assert np.median(gaps) < 0.2 * np.median(without)


def test_what_it_has_learned_is_low_at_the_best_and_between_0_and_1_on_the_samples():
    agent = minimize(CAMEL, 1)
    learned = agent.surrogate(agent.samples)
    assert learned.min() == pytest.approx(0.0, abs=1e-3)
    assert learned.max() == pytest.approx(1.0, abs=1e-3)
    assert np.array_equal(agent.samples[learned.argmin()], agent.best)
    fresh = GLIS(agent.space)
    assert np.array_equal(fresh.surrogate(agent.samples), np.zeros(30))
    with pytest.raises(KnobError):
        agent.surrogate(np.zeros((1, 3)))


@pytest.mark.parametrize(
    "bad",
    [
        {"alpha": -1.0},
        {"delta": np.nan},
        {"rbf": "thin_plate_spline"},
        {"epsilons": ()},
        {"epsilons": (0.0,)},
        {"epsilons": 1.0},
        {"ceiling": 0.0},
    ],
)
def test_impossible_settings_are_refused(bad):
    with pytest.raises(SettingsError, match=next(iter(bad))):
        GLISSettings(**bad)
    with pytest.raises(SettingsError, match="GLISSettings"):
        GLIS(CAMEL.space, settings=bad)
