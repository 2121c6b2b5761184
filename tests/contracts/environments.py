"""What every environment must satisfy; each is one parameter of the tests here.

A subject is a function that makes the environment through `gym.make`, by keyword `render_mode`.
"""

import json
import pickle
import warnings
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env as gymnasium_check

Make = Callable[..., gym.Env[Any, Any]]


def passes_the_checker_of_gymnasium_without_a_warning(make: Make) -> None:
    for mode in (None, "rgb_array"):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            gymnasium_check(make(render_mode=mode).unwrapped)


def passes_the_checker_of_stable_baselines3_without_a_warning(make: Make) -> None:
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        checker.check_env(make(render_mode="rgb_array").unwrapped, skip_render_check=False)


def repeats_itself(make: Make) -> None:
    first, second = _episode(make()), _episode(make())
    assert len(first) == len(second)
    for a, b in zip(first, second, strict=True):
        assert np.array_equal(a[0], b[0])
        assert a[1:4] == b[1:4]
        assert a[4].keys() == b[4].keys()
        assert all(np.array_equal(a[4][k], b[4][k]) for k in a[4])


def observes_and_rewards_within_bounds(make: Make) -> None:
    env = make()
    for observation, reward, terminated, truncated, _ in _episode(env):
        assert env.observation_space.contains(observation)
        assert isinstance(reward, float)
        assert np.isfinite(reward)
        assert type(terminated) is type(truncated) is bool


def acts_and_observes_in_the_unit_box(make: Make) -> None:
    env = make()
    for space in (env.action_space, env.observation_space):
        assert isinstance(space, gym.spaces.Box)
        assert space.dtype == np.float32
        assert np.all(space.low == -1)
        assert np.all(space.high == 1)


def takes_actions_of_either_precision(make: Make) -> None:
    for dtype in (np.float32, np.float64):
        env = make()
        env.reset(seed=0)
        env.step(np.full(env.action_space.shape or (), 0.25, dtype))


def informs_in_plain_data(make: Make) -> None:
    for *_, info in _episode(make()):
        plain = {k: v for k, v in info.items() if k not in ("experiment", "incumbent")}
        assert not any(isinstance(v, (np.bool_, np.number)) for v in plain.values())
        lists = {k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in plain.items()}
        json.dumps(lists, allow_nan=False)


def draws_pictures_of_one_size(make: Make) -> None:
    env = make(render_mode="rgb_array")
    env.reset(seed=0)
    env.step(env.action_space.sample())
    first, second = env.render(), env.render()
    assert isinstance(first, np.ndarray)
    assert first.dtype == np.uint8
    assert first.ndim == 3
    assert first.shape[2] == 3
    assert np.array_equal(first, second)
    env.close()
    env.close()


def draws_nothing_unless_asked(make: Make) -> None:
    env = make().unwrapped
    env.reset(seed=0)
    assert env.render() is None


def can_be_made_again_from_its_spec(make: Make) -> None:
    env = make()
    assert env.spec is not None
    assert _same_first_step(gym.make(env.spec), env)


def survives_pickling(make: Make) -> None:
    env = make(render_mode="rgb_array")
    env.reset(seed=0)
    env.step(env.action_space.sample())
    env.render()
    assert _same_first_step(pickle.loads(pickle.dumps(env)), env)


def _same_first_step(one: gym.Env[Any, Any], other: gym.Env[Any, Any]) -> bool:
    action = np.full(one.action_space.shape or (), 0.25)
    results = []
    for env in (one, other):
        env.reset(seed=0)
        results.append(env.step(action))
    return np.array_equal(results[0][0], results[1][0]) and results[0][1] == results[1][1]


def _episode(env: gym.Env[Any, Any], n: int = 30) -> list[tuple[Any, ...]]:
    env.reset(seed=1)
    env.action_space.seed(1)
    steps: list[tuple[Any, ...]] = []
    while len(steps) < n and not (steps and (steps[-1][2] or steps[-1][3])):
        steps.append(env.step(env.action_space.sample()))
    return steps


CONTRACT = (
    passes_the_checker_of_gymnasium_without_a_warning,
    passes_the_checker_of_stable_baselines3_without_a_warning,
    repeats_itself,
    observes_and_rewards_within_bounds,
    acts_and_observes_in_the_unit_box,
    takes_actions_of_either_precision,
    informs_in_plain_data,
    draws_pictures_of_one_size,
    draws_nothing_unless_asked,
    can_be_made_again_from_its_spec,
    survives_pickling,
)
environment_contract = pytest.mark.parametrize("clause", CONTRACT, ids=lambda c: c.__name__)
