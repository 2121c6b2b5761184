"""Preferences as a reward."""

import numpy as np
import pytest

from prefcal_env.calibrators import LatentCost
from prefcal_env.envs.tuning_env import PreferenceReward, TuningEnv
from prefcal_env.errors import PreferenceError, SettingsError
from prefcal_env.knobs import Knob, KnobSpace
from support.short_runs import final_level, short_run

SPACE = KnobSpace([Knob("level", 0.0, 2.0)])


class Abstains:
    def prefer(self, challenger, incumbent):
        return None


class Mumbles:
    def prefer(self, challenger, incumbent):
        return "the left one"


def judged(calibrator=None) -> PreferenceReward:
    env = TuningEnv(SPACE, lambda theta, seed: short_run(theta, value=theta[0]))
    return PreferenceReward(env, calibrator or LatentCost(final_level, tie_band=0.05))


def steps(env: PreferenceReward, *actions: float) -> list[tuple]:
    results = []
    for a in actions:
        env.reset()
        observation, reward, _, _, info = env.step(np.array([a]))
        results.append((reward, info.get("preference"), float(observation[0])))
        assert info["incumbent"].theta[0] == pytest.approx(observation[0] + 1)
    return results


def test_better_is_one_worse_is_minus_one_and_a_tie_nothing():
    assert steps(judged(), 0.0, -0.5, 0.5, -0.53125) == [
        (0.0, None, 0.0),  # the first one has nothing to beat
        (1.0, -1, -0.5),
        (-1.0, 1, -0.5),
        (0.0, 0, -0.5),  # within the tie band: the incumbent stays
    ]


def test_an_abstention_is_nothing_and_the_incumbent_stays():
    assert steps(judged(Abstains()), 0.5, -0.5) == [(0.0, None, 0.5), (0.0, None, 0.5)]


def test_a_seed_starts_over_and_no_seed_carries_on():
    env = judged()
    steps(env, -0.5)
    assert env.reset()[0].tolist() == [-0.5]
    assert env.reset(seed=1)[0].tolist() == [0.0]
    assert steps(env, 0.5) == [(0.0, None, 0.5)]


def test_no_calibrator_and_no_answer_are_refused():
    with pytest.raises(SettingsError, match="method prefer, got 3"):
        PreferenceReward(judged().env, 3)
    with pytest.raises(PreferenceError, match="the left one"):
        steps(judged(Mumbles()), 0.0, 0.1)


def test_an_environment_without_experiments_is_refused():
    from support.tank import tank_env

    env = PreferenceReward(tank_env(), Abstains())
    env.reset()
    with pytest.raises(SettingsError, match="info\\['experiment'\\]"):
        env.step(np.zeros(1))
