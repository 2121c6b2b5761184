"""Every registered environment keeps the contract, alone and in vectors."""

from functools import partial

import gymnasium as gym
import numpy as np
import pytest

from contracts.environments import environment_contract
from prefcal_env import PrefcalError
from support.environments import SUBJECTS


@pytest.fixture(autouse=True)
def no_window(monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")


@environment_contract
@pytest.mark.parametrize("subject", SUBJECTS)
def test_environment(clause, subject):
    clause(partial(gym.make, subject, **SUBJECTS[subject]))


@pytest.mark.parametrize("env_id", SUBJECTS)
def test_it_is_made_with_and_without_the_name_of_the_module(env_id):
    for name in (env_id, f"prefcal_env:{env_id}"):
        assert gym.make(name, **SUBJECTS[env_id]).spec.id == env_id


@pytest.mark.parametrize("mode", ["sync", "async", None])
@pytest.mark.parametrize("env_id", SUBJECTS)
def test_vectors_do_what_single_ones_do(env_id, mode):
    kwargs = SUBJECTS[env_id]
    vector = gym.make_vec(env_id, num_envs=2, vectorization_mode=mode, **kwargs)
    actions = np.array([[0.1] * vector.single_action_space.shape[0]] * 2, np.float32)
    actions[1] = -0.3
    vector.reset(seed=0)
    rewards = vector.step(actions)[1]
    vector.close()
    for action, reward in zip(actions, rewards, strict=True):
        env = gym.make(env_id, **kwargs)
        env.reset(seed=0)
        assert env.step(action)[1] == reward


SETTINGS = {
    "prefcal/CSTR-v0": {"T_s": 0.5, "x0": [310.0, 8.4], "max_move": 5.0},
    "prefcal/CSTRTuning-v0": {"T_s": 0.5, "x0": [310.0, 8.4], "max_move": 5.0},
    "prefcal/Overtake-v0": {"T_s": 0.2, "x0": [5.0, 1.0, 0.0], "config": {"lanes_count": 3}},
    "prefcal/OvertakeTuning-v0": {
        "T_s": 0.2,
        "x0": [5.0, 1.0, 0.0],
        "config": {"lanes_count": 3, "steering_limit": "per step"},
    },
}


@pytest.mark.parametrize("env_id", SETTINGS)
def test_sampling_time_start_and_options_are_keywords(env_id):
    settings = SETTINGS[env_id]
    for env in (
        gym.make(env_id, **settings),
        gym.make_vec(env_id, num_envs=1, vectorization_mode="sync", **settings).envs[0],
        gym.make_vec(env_id, num_envs=1, **settings).envs[0],
    ):
        env.reset(seed=0)
        *_, info = env.step(np.zeros(env.action_space.shape, np.float32))
        if "experiment" not in info:
            assert info["t"] == settings["T_s"]
            continue
        assert info["theta"][0] == settings["T_s"]
        assert info["experiment"].x[0].tolist() == settings["x0"]
        assert info["experiment"].t_control[1] == settings["T_s"]


def test_what_cannot_be_is_refused_when_an_environment_is_made():
    for env_id, settings in [
        ("CSTR", {"T_s": 0.0}),
        ("CSTR", {"x0": [1.0]}),
        ("CSTRTuning", {"T_s": 10.0}),
        ("CSTRTuning", {"x0": [1.0]}),
        ("Overtake", {"T_s": 1.0}),
        ("Overtake", {"x0": [26, 0, 0]}),
        ("OvertakeTuning", {"T_s": 1.0}),
        ("OvertakeTuning", {"config": {"lanes": 3}}),
    ]:
        with pytest.raises(PrefcalError):
            gym.make(f"prefcal/{env_id}-v0", **settings)
