"""Provide SAC as a value-based agent: a critic of all experiments, and an actor following it."""

from typing import Any, ClassVar, final

import numpy as np
from jaxtyping import Float

from prefcal_agents.history.lessons import cube_of, scores_of
from prefcal_agents.optimize.search import Tried
from prefcal_agents.protocol.agent import ValueBased
from prefcal_agents.protocol.replay import Replay
from prefcal_agents.space.design import latin_hypercube
from prefcal_agents.support.checks import integer, number
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.preferences.history import History

from .bandit import OBSERVATION, Bandit, actions, rewards, sample
from .library import silent, stable_baselines, torch_seeded


@final
class SACBandit(ValueBased):
    """SAC of stable-baselines3 with exactly `n_max` experiments, each an episode of one step.

    The first `n_init` samples are a Latin hypercube, where the library draws uniformly. From then
    on the networks are trained on all experiments after each new one, and the actor proposes the
    next. Instead of the library's own loop, which would run the experiments, the buffer is filled
    from the history with the θ that ran.

    Deviation: rewards are ranks (see `rewards`); the library does nothing before 100 steps, so
    here the gradient steps are more and larger, and the weight of the entropy is fixed.

    Args:
        space: Knobs to tune.
        n_init: Number of samples of the start, 1 or more.
        n_max: Number of experiments.
        seed: Seed of all randomness, 0 or more.
        gradient_steps: Number of gradient steps after each experiment.
        learning_rate: Learning rate of the optimizers, above 0.
        entropy: Weight of the policy's entropy relative to rewards in [-1, 1]; large explores.

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
        gradient_steps: int = 20,
        learning_rate: float = 0.01,
        entropy: float = 0.01,
    ) -> None:
        integer("gradient_steps", gradient_steps, low=1)
        number("learning_rate", learning_rate, strict=True)
        number("entropy", entropy)
        self._gradient_steps = int(gradient_steps)
        self._learning_rate, self._entropy = float(learning_rate), float(entropy)
        super().__init__(space, n_init=n_init, n_max=n_max, seed=seed)
        self._library = stable_baselines()
        self._replay = Replay(self._start, self._feed)

    def _settings(self) -> dict[str, Any]:
        return {
            "gradient_steps": self._gradient_steps,
            "learning_rate": self._learning_rate,
            "entropy": self._entropy,
        }

    def _propose(self, history: History) -> Float[np.ndarray, " n"]:
        index = history.answered
        if index < self.n_init:
            z = latin_hypercube(self.space, self.n_init, self._seed)[index]
        else:
            model = self._replay.at(history)
            with torch_seeded(self._seed, index, 1):
                action, _ = model.policy.predict(OBSERVATION[0], deterministic=False)
            z = sample(action)
        rng = np.random.default_rng([self._seed, index])
        return Tried(self.space, history).fresh(z, rng)

    def _start(self) -> Any:
        with torch_seeded(self._seed, 0, 0):
            model = self._library.SAC(
                "MlpPolicy",
                Bandit(len(self.space)),
                learning_rate=self._learning_rate,
                buffer_size=self.n_max,
                batch_size=32,
                ent_coef=self._entropy,
                policy_kwargs={"net_arch": [64, 64]},
                device="cpu",
            )
        return silent(model)

    def _feed(self, model: Any, history: History) -> None:
        scored, values = scores_of(history)
        if history.comparisons[-1].value is not None:
            taken = actions(cube_of(history)[scored[-1:]])
            end = np.ones(1)
            model.replay_buffer.add(OBSERVATION, OBSERVATION, taken, np.zeros(1), end, [{}])
            model.replay_buffer.rewards[: len(scored), 0] = rewards(values)
        if history.answered >= self.n_init and len(scored):
            with torch_seeded(self._seed, history.answered, 2):
                model.train(self._gradient_steps, model.batch_size)
