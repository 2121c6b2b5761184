"""Provide PPO as a value-based agent: a Gaussian over θ that moves to low scores."""

from typing import Any, ClassVar, final

import numpy as np
from jaxtyping import Float

from prefcal_agents.history.lessons import cube_of, scores_of
from prefcal_agents.optimize.search import Tried
from prefcal_agents.protocol.agent import ValueBased
from prefcal_agents.protocol.replay import Replay
from prefcal_agents.support.checks import integer, number
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.preferences.history import History

from .bandit import OBSERVATION, Bandit, actions, rewards, sample
from .library import silent, stable_baselines, torch_seeded


@final
class PPOBandit(ValueBased):
    """PPO of stable-baselines3 with exactly `n_max` experiments, each an episode of one step.

    The policy is a Gaussian, updated after every `n_steps` experiments with a score. Instead of the
    library's own loop, which would run the experiments, the buffer is filled from the history with
    the θ that ran. The policy has no network, since there is no observation.

    Deviation: rewards are ranks (see `rewards`); settings other than the library's, which are
    for thousands of times as many steps: `n_steps`, `learning_rate`, `target_kl` and the width.

    Args:
        space: Knobs to tune.
        n_init: Required of all agents, without effect here; 1 or more.
        n_max: Number of experiments.
        seed: Seed of all randomness, 0 or more.
        n_steps: Number of experiments between two updates, 2 or more.
        n_epochs: Number of gradient steps of an update.
        learning_rate: Learning rate of the optimizer, above 0.

    Raises:
        SettingsError: If a value is not valid.
        MissingExtraError: If the extra `rl` is not installed.
    """

    version: ClassVar[int] = 1

    def __init__(
        self,
        space: KnobSpace,
        *,
        n_init: int = 10,
        n_max: int = 50,
        seed: int = 0,
        n_steps: int = 5,
        n_epochs: int = 20,
        learning_rate: float = 0.03,
    ) -> None:
        integer("n_steps", n_steps, low=2)
        integer("n_epochs", n_epochs, low=1)
        number("learning_rate", learning_rate, strict=True)
        self._n_steps, self._n_epochs = int(n_steps), int(n_epochs)
        self._learning_rate = float(learning_rate)
        super().__init__(space, n_init=n_init, n_max=n_max, seed=seed)
        self._library = stable_baselines()
        self._replay = Replay(self._start, self._feed)

    def _settings(self) -> dict[str, Any]:
        return {
            "n_steps": self._n_steps,
            "n_epochs": self._n_epochs,
            "learning_rate": self._learning_rate,
        }

    def _propose(self, history: History) -> Float[np.ndarray, " n"]:
        model = self._replay.at(history)
        with torch_seeded(self._seed, history.answered, 1):
            action, _ = model.policy.predict(OBSERVATION[0], deterministic=False)
        rng = np.random.default_rng([self._seed, history.answered])
        return Tried(self.space, history).fresh(sample(action), rng)

    def _start(self) -> Any:
        with torch_seeded(self._seed, 0, 0):
            model = self._library.PPO(
                "MlpPolicy",
                Bandit(len(self.space)),
                n_steps=self._n_steps,
                batch_size=self._n_steps,
                n_epochs=self._n_epochs,
                learning_rate=self._learning_rate,
                target_kl=1.5,  # stops an update before its ratios overflow
                policy_kwargs={"net_arch": [], "log_std_init": -0.5},
                device="cpu",
            )
        return silent(model)

    def _feed(self, model: Any, history: History) -> None:
        scored, values = scores_of(history)
        if history.comparisons[-1].value is None or len(scored) % self._n_steps:
            return
        batch = slice(-self._n_steps, None)
        with torch_seeded(self._seed, history.answered, 2):
            _fill(model, actions(cube_of(history)[scored][batch]), rewards(values)[batch])
            model.train()


def _fill(model: Any, taken: Any, reward: Float[np.ndarray, " K"]) -> None:
    """Put K experiments into the rollout buffer, as if the current policy had just run them."""
    from torch import as_tensor, no_grad

    policy, buffer = model.policy, model.rollout_buffer
    with no_grad():
        seen = as_tensor(np.repeat(OBSERVATION, len(taken), axis=0))
        value, log_prob, _ = policy.evaluate_actions(seen, as_tensor(taken))
    buffer.reset()
    for k, action in enumerate(taken):
        # Every experiment is one episode.
        buffer.add(
            OBSERVATION, action[None], reward[k : k + 1], np.ones(1), value[k], log_prob[k : k + 1]
        )
    buffer.compute_returns_and_advantage(last_values=value[-1], dones=np.ones(1))
