"""Every registered environment passes the checker of stable-baselines3."""

import warnings

import gymnasium as gym
import pytest

from bench_support.extras import need
from prefcal_env import LatentCost
from prefcal_env.envs.tuning_env import PreferenceReward
from support.environments import OWN, SUBJECTS
from support.short_runs import final_level


@pytest.fixture
def check():
    need("rl")
    from stable_baselines3.common.env_checker import check_env

    return check_env


@pytest.mark.parametrize("subject", SUBJECTS)
def test_it_passes_without_a_warning(subject, check, monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    env = gym.make(subject, render_mode="rgb_array", **SUBJECTS[subject]).unwrapped
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check(env, skip_render_check=False)


def test_preferences_as_a_reward_pass(check):
    env = PreferenceReward(gym.make("prefcal/Experiment-v0", **OWN), LatentCost(final_level))
    check(env)
