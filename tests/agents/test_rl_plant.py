"""Control learned on the plant."""

import gymnasium as gym
import numpy as np
import pytest

from prefcal_agents.rl import TrainedPolicy, evaluate, train_on_plant
from prefcal_agents.rl.plant import SETTINGS
from prefcal_env import End, rollout
from prefcal_env.errors import SettingsError
from support.extras import need

CSTR = "prefcal_env:prefcal/CSTR-v0"


@pytest.fixture(autouse=True)
def _small(monkeypatch):
    need("rl")
    monkeypatch.setitem(SETTINGS, "PPO", {**SETTINGS["PPO"], "n_steps": 100})
    monkeypatch.setitem(SETTINGS, "SAC", {"learning_starts": 50, "batch_size": 8})


@pytest.fixture
def env():
    return gym.make(CSTR)


@pytest.mark.parametrize("algorithm", ["PPO", "SAC"])
def test_training_takes_the_steps_that_it_says_and_is_deterministic(algorithm, env):
    trained = [train_on_plant(CSTR, algorithm, steps=100, seed=s) for s in (1, 1, 2)]
    assert [policy.origin.steps for policy in trained] == [100, 100, 100]
    returns = [evaluate(policy, env).total_reward for policy in trained]
    assert returns[0] == returns[1] != returns[2]
    untrained = train_on_plant(CSTR, algorithm, steps=0, seed=1)
    assert untrained.origin.steps == 0
    assert evaluate(untrained, env).total_reward != returns[0]


def test_an_episode_of_a_policy_is_an_experiment_like_any_other(env):
    policy = train_on_plant(steps=0)
    seen = evaluate(policy, env)
    record = env.unwrapped.record()
    experiment = rollout(env, policy.controller(env), theta=np.zeros(1))
    assert np.array_equal(experiment.x, record.x)
    assert (seen.steps, seen.time) == (len(experiment.t_control), experiment.duration)
    assert End(seen.end) is experiment.end
    assert experiment.end is End.TIME_UP
    assert seen.time == pytest.approx(48.0)


def test_a_policy_controls_the_car_too():
    env = gym.make("prefcal_env:prefcal/Overtake-v0")
    policy = train_on_plant("prefcal_env:prefcal/Overtake-v0", steps=0)
    assert np.isfinite(evaluate(policy, env).total_reward)
    assert rollout(env, policy.controller(env), theta=np.zeros(1)).solved.all()


@pytest.mark.parametrize("algorithm", ["PPO", "SAC"])
def test_a_policy_is_saved_and_loaded(algorithm, env, tmp_path):
    policy = train_on_plant(CSTR, algorithm, steps=100)
    path = policy.save(tmp_path / "policy.v1")
    assert path.name == "policy.v1.zip"
    again = TrainedPolicy.load(path)
    assert again.origin == policy.origin
    assert evaluate(again, env) == evaluate(policy, env)


def test_a_file_that_holds_no_policy_is_refused(tmp_path):
    (tmp_path / "text.zip").write_text("nothing")
    for name in ("text.zip", "absent.zip"):
        with pytest.raises(SettingsError, match=name):
            TrainedPolicy.load(tmp_path / name)


def test_impossible_trainings_are_refused():
    for options, word in (
        ({"algorithm": "DQN"}, "algorithm"),
        ({"steps": -1}, "steps"),
        ({"steps": 10.5}, "steps"),
        ({"seed": -1}, "seed"),
        ({"env_id": "prefcal_env:prefcal/Nothing-v0"}, "Nothing-v0"),
        ({"env_id": "no_such_module:Nothing-v0"}, "no_such_module"),
    ):
        with pytest.raises(SettingsError, match=word):
            train_on_plant(**options)


def test_a_policy_refuses_an_environment_that_it_cannot_observe():
    policy = train_on_plant(steps=0)
    with pytest.raises(SettingsError, match="observe"):
        policy.controller(gym.make("CartPole-v1"))


def test_the_bar_shows_and_goes(capsys):
    train_on_plant(steps=100, progress=True)
    assert capsys.readouterr().out == ""
