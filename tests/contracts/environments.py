"""What every environment must satisfy; each is one parameter of the tests here.

A subject is a function that makes the environment through `gym.make`, by keyword `render_mode`.
"""

import json
import pickle
import warnings
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env as gymnasium_check
from gymnasium.wrappers import (
    FrameStackObservation,
    RecordEpisodeStatistics,
    RecordVideo,
    TimeAwareObservation,
)

from prefcal_env.errors import PrefcalError

Make = Callable[..., gym.Env[Any, Any]]


def passes_the_checker_of_gymnasium_without_a_warning(make: Make) -> None:
    for mode in (None, "rgb_array"):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            gymnasium_check(make(render_mode=mode).unwrapped)


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


def refuses_actions_that_are_no_plain_numbers(make: Make) -> None:
    env = make()
    n = env.action_space.shape[0]
    for action in (
        np.ma.masked_array(np.zeros(n), mask=[True] + [False] * (n - 1)),
        np.zeros(n, "timedelta64[s]"),
        np.zeros(n, "datetime64[s]"),
        np.zeros(n, complex),
        np.array(["0"] * n),
        np.zeros(n, bool),
        [None] * n,
        np.zeros(n + 1),
        np.full(n, np.nan),
    ):
        env.reset(seed=0)
        with pytest.raises(PrefcalError, match="action must"):
            env.unwrapped.step(action)


def draws_pictures_of_one_size(make: Make) -> None:
    env = make(render_mode="rgb_array")
    env.reset(seed=0)
    before = env.render()
    env.step(env.action_space.sample())
    first, second = env.render(), env.render()
    assert before.shape == first.shape
    assert isinstance(first, np.ndarray)
    assert first.dtype == np.uint8
    assert first.ndim == 3
    assert first.shape[2] == 3
    assert np.array_equal(first, second)
    env.close()
    env.close()


def shows_itself_in_a_window(make: Make) -> None:
    env = make(render_mode="human")
    env.reset(seed=0)
    env.step(env.action_space.sample())
    assert env.render() is None
    env.close()


def draws_lists_of_pictures(make: Make) -> None:
    env = make(render_mode="rgb_array_list")
    env.reset(seed=0)
    env.step(env.action_space.sample())
    assert len({frame.shape for frame in env.render()}) == 1
    env.close()


def records_videos(make: Make) -> None:
    pytest.importorskip("moviepy")
    with TemporaryDirectory() as folder:
        env = RecordVideo(make(render_mode="rgb_array"), folder, disable_logger=True)
        env.reset(seed=0)
        env.step(env.action_space.sample())
        env.close()
        (video,) = Path(folder).glob("*.mp4")
        assert video.stat().st_size > 1000


def counts_episodes(make: Make) -> None:
    steps = _episode(RecordEpisodeStatistics(make()), 1000)
    info = steps[-1][4]
    assert info["episode"]["l"] == len(steps)
    total = sum(step[1] for step in steps)
    assert info["episode"]["r"] == pytest.approx(total, rel=1e-4, abs=1e-5)


def tells_the_time(make: Make) -> None:
    env = TimeAwareObservation(make(max_episode_steps=10), flatten=True)
    assert env.observation_space.contains(env.reset(seed=0)[0])
    assert env.observation_space.contains(env.step(env.action_space.sample())[0])


def stacks_observations(make: Make) -> None:
    env = FrameStackObservation(make(), 3)
    assert env.observation_space.contains(env.reset(seed=0)[0])
    assert env.observation_space.contains(env.step(env.action_space.sample())[0])


def is_wrapped_in_vectors(make: Make) -> None:
    wrappers = gym.wrappers.vector
    vector = wrappers.RecordEpisodeStatistics(gym.vector.SyncVectorEnv([make] * 2))
    vector = wrappers.ClipAction(vector)
    vector.reset(seed=0)
    observations, rewards, *_ = vector.step(vector.action_space.sample())
    assert vector.observation_space.contains(observations)
    assert rewards.shape == (2,)
    vector.close()


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
    repeats_itself,
    observes_and_rewards_within_bounds,
    acts_and_observes_in_the_unit_box,
    takes_actions_of_either_precision,
    informs_in_plain_data,
    refuses_actions_that_are_no_plain_numbers,
    draws_pictures_of_one_size,
    shows_itself_in_a_window,
    draws_lists_of_pictures,
    pytest.param(records_videos, marks=pytest.mark.libraries),
    counts_episodes,
    tells_the_time,
    stacks_observations,
    is_wrapped_in_vectors,
    draws_nothing_unless_asked,
    can_be_made_again_from_its_spec,
    survives_pickling,
)
environment_contract = pytest.mark.parametrize("clause", CONTRACT, ids=lambda c: c.__name__)
