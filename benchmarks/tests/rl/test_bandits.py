"""PPO and SAC within a budget of experiments."""

import sys

import numpy as np
import pytest

from bench_support.extras import need
from prefcal_bench.global_random import seeded
from prefcal_bench.rl import PPOBandit, SACBandit, bandits
from prefcal_bench.rl.bandits import rewards
from prefcal_env.errors import MissingExtraError
from prefcal_env.knobs import Knob, KnobSpace

LINE = KnobSpace([Knob("x", 0.0, 4.0), Knob("y", -1.0, 1.0)])
EACH = pytest.mark.parametrize("make", [PPOBandit, SACBandit])


def bowl(theta):
    return float((theta[0] - 3.0) ** 2 + 4 * (theta[1] + 0.5) ** 2)


def step(agent):
    query = agent.ask()
    value = bowl(query.challenger.theta)
    agent.tell(query, value)
    return value


@pytest.fixture(autouse=True)
def _installed():
    need("rl")


@EACH
def test_exactly_n_max_experiments_are_asked_for_and_training_improves_them(make, monkeypatch):
    monkeypatch.setattr(bandits, "SAC_STEPS", 5)
    agent = make(LINE, n_init=10, n_max=50, seed=0)
    values = []
    while not agent.done:
        values.append(step(agent))
    assert len(values) == 50
    assert bowl(agent.best) == min(values)
    assert np.median(values[-10:]) < 0.3 * np.median(values[:10])


@EACH
def test_two_agents_and_the_caller_do_not_disturb_each_other(make, monkeypatch):
    monkeypatch.setattr(bandits, "SAC_STEPS", 2)  # enough to depend on them
    import torch

    def alone(seed):
        agent = make(LINE, n_init=3, n_max=9, seed=seed)
        while not agent.done:
            step(agent)
        return agent.samples

    expected = [alone(0), alone(1)]
    with seeded(5):
        torch.manual_seed(5)
        undisturbed = np.random.rand(), torch.rand(1).item()  # noqa: NPY002
    with seeded(5):
        torch.manual_seed(5)
        threads = torch.get_num_threads()
        agents = [make(LINE, n_init=3, n_max=9, seed=seed) for seed in (0, 1)]
        while not agents[0].done:
            for agent in agents:
                step(agent)
        assert (np.random.rand(), torch.rand(1).item()) == undisturbed  # noqa: NPY002
        assert torch.get_num_threads() == threads
    for agent, samples in zip(agents, expected, strict=True):
        assert np.array_equal(agent.samples, samples)


def test_a_reward_is_a_rank():
    assert np.allclose(rewards(np.array([3.0, 1e9, -2.0, 3.0])), [0.0, -0.75, 0.75, 0.0])
    assert np.allclose(rewards(np.ones(4)), 0.0)
    assert np.allclose(rewards(np.array([5.0])), 0.0)


@EACH
def test_without_the_extra_the_word_is_clear(make, monkeypatch):
    monkeypatch.setitem(sys.modules, "stable_baselines3", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'prefcal-bench\[rl\]'"):
        make(LINE)
