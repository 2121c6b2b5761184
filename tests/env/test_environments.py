"""Every registered environment keeps the contract, alone and in vectors."""

from functools import partial

import gymnasium as gym
import numpy as np
import pytest

import prefcal_env
from contracts.environments import environment_contract
from prefcal_env import Knob, KnobSpace, LatentCost, PreferenceReward
from support.short_runs import final_level
from support.tank import pi_of, tank_env

OWN = {
    "space": KnobSpace([Knob("K_p", 0.1, 2.0), Knob("K_i", 0.0, 1.0)]),
    "env": tank_env,
    "controller": pi_of,
    "score": final_level,
}
SUBJECTS = {
    "prefcal/CSTR-v0": {},
    "prefcal/CSTRTuning-v0": {},
    "prefcal/Experiment-v0": OWN,
    "prefcal/Overtake-v0": {},
    "prefcal/OvertakeTuning-v0": {},
}


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


def test_a_vector_of_one_step_episodes_can_be_run_in_processes_without_wasted_steps():
    mode = gym.vector.AutoresetMode.SAME_STEP
    vector = gym.make_vec(
        "prefcal/Experiment-v0", num_envs=2, vectorization_mode="async",
        vector_kwargs={"autoreset_mode": mode}, **OWN,
    )  # fmt: skip
    vector.reset(seed=0)
    for _ in range(2):
        *_, terminated, _, infos = vector.step(np.zeros((2, 2), np.float32))
        assert terminated.all()
        assert all(isinstance(e, prefcal_env.Experiment) for e in infos["final_info"]["experiment"])
    vector.close()


def test_preferences_as_a_reward_pass_the_checkers():
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    env = PreferenceReward(gym.make("prefcal/Experiment-v0", **OWN), LatentCost(final_level))
    checker.check_env(env)
