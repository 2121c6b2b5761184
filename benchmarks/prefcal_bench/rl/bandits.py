"""Tune by reinforcement learning: a bandit whose episodes have one step, an experiment each."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, ClassVar, final

import gymnasium as gym
import numpy as np
from jaxtyping import Float

from prefcal_agents.agent import Agent
from prefcal_agents.lessons import cube_of, scores_of
from prefcal_agents.search import latin_hypercube
from prefcal_bench.extras import load
from prefcal_bench.global_random import seeded
from prefcal_bench.replay import Replay
from prefcal_env.preferences.history import History

PPO_STEPS = 5  # number of experiments with a score between two updates of PPO
SAC_STEPS = 20  # number of gradient steps of SAC after each experiment
_OBSERVATION = np.ones((1, 1), np.float32)  # always the same: each experiment starts from scratch

Array = np.ndarray[Any, Any]


class _Bandit(gym.Env[Array, Array]):
    """An environment that only provides spaces; the agent takes the steps, one per query."""

    def __init__(self, n: int) -> None:
        self.observation_space = gym.spaces.Box(0.0, 1.0, (1,), np.float32)
        self.action_space = gym.spaces.Box(-1.0, 1.0, (n,), np.float32)


class _Learner(Agent):
    """An agent whose samples a model of stable-baselines3 proposes.

    Instead of the library's own loop, which would run the experiments, its buffer is filled from
    the history with the θ that ran.
    """

    by_value = True

    def _prepare(self) -> None:
        self._library = load("stable_baselines3", "rl")
        self._replay = Replay(self._start, self._feed)

    def propose(self, history: History) -> Float[np.ndarray, " n"]:
        """Return the next point: of the start, or an action of the policy."""
        z = self._planned(history.answered)
        if z is not None:
            return z
        model = self._replay.at(history)
        with _torch_seeded(self.setup.seed, history.answered, 1):
            action, _ = model.policy.predict(_OBSERVATION[0], deterministic=False)
        return np.clip((np.asarray(action, dtype=float) + 1) / 2, 0.0, 1.0)

    def _planned(self, index: int) -> Float[np.ndarray, " n"] | None:
        """Return the sample of the start with this index; None after the start."""
        return None

    def _start(self) -> Any:
        with _torch_seeded(self.setup.seed, 0, 0):
            model = self._model(_Bandit(len(self.space)))
        logger = load("stable_baselines3.common.logger", "rl")
        model.set_logger(logger.Logger(None, []))  # one that keeps no log
        return model

    def _model(self, env: gym.Env[Array, Array]) -> Any:
        """Return the untrained model."""
        raise NotImplementedError

    def _feed(self, model: Any, history: History) -> None:
        """Show the model the last experiment of `history`, and train it."""
        raise NotImplementedError


@final
class PPOBandit(_Learner):
    """PPO of stable-baselines3 with exactly `n_max` experiments, each an episode of one step.

    The policy is a Gaussian over θ that moves to low scores, updated after every `PPO_STEPS`
    experiments with a score. It has no network, since there is no observation.

    Deviation: rewards are ranks (see `rewards`); settings other than the library's, which are
    for thousands of times as many steps.

    Arguments and errors are those of `Agent`; `n_init` has no effect. Without the extra `rl`,
    MissingExtraError is raised.
    """

    version: ClassVar[int] = 1

    def _model(self, env: gym.Env[Array, Array]) -> Any:
        return self._library.PPO(
            "MlpPolicy",
            env,
            n_steps=PPO_STEPS,
            batch_size=PPO_STEPS,
            n_epochs=20,
            learning_rate=0.03,
            target_kl=1.5,  # stops an update before its ratios overflow
            policy_kwargs={"net_arch": [], "log_std_init": -0.5},
            device="cpu",
        )

    def _feed(self, model: Any, history: History) -> None:
        scored, values = scores_of(history)
        if history.comparisons[-1].value is None or len(scored) % PPO_STEPS:
            return
        batch = slice(-PPO_STEPS, None)
        with _torch_seeded(self.setup.seed, history.answered, 2):
            _fill(model, _actions(cube_of(history)[scored][batch]), rewards(values)[batch])
            model.train()


@final
class SACBandit(_Learner):
    """SAC of stable-baselines3 with exactly `n_max` experiments, each an episode of one step.

    The first `n_init` samples are a Latin hypercube, where the library draws uniformly. From then
    on a critic is trained on all experiments after each new one, and the actor that follows it
    proposes the next.

    Deviation: rewards are ranks (see `rewards`); the library does nothing before 100 steps, so
    here the gradient steps are more and larger, and the weight of the entropy is fixed.

    Arguments and errors are those of `Agent`. Without the extra `rl`, MissingExtraError is raised.
    """

    version: ClassVar[int] = 1

    def _planned(self, index: int) -> Float[np.ndarray, " n"] | None:
        if index >= self.setup.n_init:
            return None
        return np.asarray(latin_hypercube(self.space, self.setup.n_init, self.setup.seed)[index])

    def _model(self, env: gym.Env[Array, Array]) -> Any:
        return self._library.SAC(
            "MlpPolicy",
            env,
            learning_rate=0.01,
            buffer_size=self.setup.n_max,
            batch_size=32,
            ent_coef=0.01,  # relative to rewards in [-1, 1]
            policy_kwargs={"net_arch": [64, 64]},
            device="cpu",
        )

    def _feed(self, model: Any, history: History) -> None:
        scored, values = scores_of(history)
        if history.comparisons[-1].value is not None:
            taken, end = _actions(cube_of(history)[scored[-1:]]), np.ones(1)
            model.replay_buffer.add(_OBSERVATION, _OBSERVATION, taken, np.zeros(1), end, [{}])
            model.replay_buffer.rewards[: len(scored), 0] = rewards(values)
        if history.answered >= self.setup.n_init and len(scored):
            with _torch_seeded(self.setup.seed, history.answered, 2):
                model.train(SAC_STEPS, model.batch_size)


def rewards(values: Float[np.ndarray, " K"]) -> Float[np.ndarray, " K"]:
    """Return the reward of each score, shape (K,), from its rank: 1 is best, -1 worst.

    Ranks do not depend on the unit of the score, nor on outliers: interrupted runs of the CSTR
    score a thousand times as much as good ones.
    """
    below = np.array([np.mean(values < value) for value in values])
    equal = np.array([np.mean(values == value) for value in values])
    return np.asarray(1.0 - 2.0 * below - equal)


def _actions(z: Float[np.ndarray, "K n"]) -> Array:
    """Return samples of the unit cube as actions in [-1, 1], float32, shape (K, n)."""
    scaled: Array = (2 * z - 1).astype(np.float32)
    return scaled


def _fill(model: Any, taken: Any, reward: Float[np.ndarray, " K"]) -> None:
    """Put K experiments into the rollout buffer, as if the current policy had just run them."""
    from torch import as_tensor, no_grad

    policy, buffer = model.policy, model.rollout_buffer
    with no_grad():
        seen = as_tensor(np.repeat(_OBSERVATION, len(taken), axis=0))
        value, log_prob, _ = policy.evaluate_actions(seen, as_tensor(taken))
    buffer.reset()
    each, end = zip(taken, value, strict=True), np.ones(1)
    for k, (action, worth) in enumerate(each):  # every experiment is one episode
        one = slice(k, k + 1)
        buffer.add(_OBSERVATION, action[None], reward[one], end, worth, log_prob[one])
    buffer.compute_returns_and_advantage(last_values=value[-1], dones=end)


@contextmanager
def _torch_seeded(*key: int) -> Iterator[int]:
    """Seed the global generators of torch, numpy and Python by `key` inside the context.

    Afterwards they are restored. Inside, torch uses one thread, which is faster for such small
    networks and gives the same digits whatever else runs.

    Yields:
        A seed below 2**32 that follows from `key`.
    """
    torch = load("torch", "rl")
    with seeded(*key) as seed, torch.random.fork_rng(devices=[]):
        torch.random.default_generator.manual_seed(seed)
        threads = torch.get_num_threads()
        torch.set_num_threads(1)
        try:
            yield seed
        finally:
            torch.set_num_threads(threads)
