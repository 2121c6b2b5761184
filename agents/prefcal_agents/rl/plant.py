"""Learn control directly on a plant environment, without a model or MPC."""

from collections.abc import Mapping
from contextlib import nullcontext
from dataclasses import dataclass
from typing import Any

import gymnasium as gym

from prefcal_agents.support.checks import choice, integer
from prefcal_agents.support.extras import load
from prefcal_env.errors import SettingsError

from .library import silent, stable_baselines, torch_seeded
from .policy import ALGORITHMS, Origin, TrainedPolicy

CSTR = "prefcal_env:prefcal/CSTR-v0"
SETTINGS: Mapping[str, Mapping[str, Any]] = {
    "PPO": {
        "n_steps": 1000,
        "batch_size": 100,
        "gamma": 0.98,
        # With the default 0, most actions exceed the limits of the plant's inputs.
        "policy_kwargs": {"log_std_init": -1.0},
    },
    "SAC": {"learning_starts": 1000, "learning_rate": 1e-3, "gamma": 0.98, "train_freq": 2},
}
"""Settings that differ from the library's, for about ten thousand training steps."""


def train_on_plant(
    env_id: str = CSTR,
    algorithm: str = "PPO",
    *,
    steps: int = 20_000,
    seed: int = 0,
    env_options: Mapping[str, Any] | None = None,
    progress: bool = False,
) -> TrainedPolicy:
    """Learn to control a plant by trial: each step is one sampling period, with its reward.

    The same arguments give the same policy, even if other code draws random numbers; the process's
    global random states do not change.

    Args:
        env_id: Id of a plant environment registered with Gymnasium.
        algorithm: "PPO" or "SAC" of stable-baselines3.
        steps: Number of sampling periods, 0 or more; 0 leaves the policy untrained. PPO rounds up
            to a multiple of its 1000.
        seed: Seed of all randomness, 0 or more.
        env_options: Keyword arguments of the environment.
        progress: Whether to show a progress bar on standard error.

    Raises:
        SettingsError: If the algorithm or environment is unknown, or a number is not valid.
        MissingExtraError: If the extra `rl` is not installed.
    """
    choice("algorithm", algorithm, ALGORITHMS)
    integer("steps", steps, low=0)
    integer("seed", seed, low=0)
    library = stable_baselines()
    try:
        env = gym.make(env_id, **dict(env_options or {}))
    except (gym.error.Error, ModuleNotFoundError) as error:
        raise SettingsError(f"no environment {env_id!r}: {error}") from error
    bar_or_none = _Bar(algorithm, steps) if progress else nullcontext()
    with torch_seeded(seed) as library_seed, bar_or_none as bar:
        make = getattr(library, algorithm)
        model = make("MlpPolicy", env, seed=library_seed, device="cpu", **SETTINGS[algorithm])
        silent(model)
        env.reset(seed=seed)
        if steps:
            model.learn(steps, callback=None if bar is None else bar.callback())
        T_s = float(env.unwrapped.T_s)  # type: ignore[attr-defined]
    return TrainedPolicy(model, Origin(algorithm, env_id, T_s, int(model.num_timesteps), seed))


@dataclass(frozen=True, slots=True)
class Evaluation:
    """One episode of a policy without exploration noise.

    Args:
        total_reward: Sum of the rewards, the return.
        steps: Number of sampling periods.
        time: Duration in the plant's unit of time.
        end: Reason for the end, as reported by the environment.
    """

    total_reward: float
    steps: int
    time: float
    end: str


def evaluate(policy: TrainedPolicy, env: gym.Env[Any, Any], seed: int = 0) -> Evaluation:
    """Run one episode of the plant environment `env` with `policy`."""
    observation, info = env.reset(seed=seed)
    total, steps, over = 0.0, 0, False
    while not over:
        observation, reward, terminated, truncated, info = env.step(policy.control(observation))
        total, steps, over = total + float(reward), steps + 1, terminated or truncated
    return Evaluation(total, steps, float(info["t"]), str(info["end"]))


class _Bar:
    """A progress bar with the remaining time."""

    def __init__(self, algorithm: str, steps: int) -> None:
        from rich.console import Console
        from rich.progress import Progress

        self._progress = Progress(console=Console(stderr=True), transient=True)
        self._task = self._progress.add_task(f"{algorithm} on the plant", total=steps)

    def __enter__(self) -> "_Bar":
        self._progress.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._progress.stop()

    def callback(self) -> Any:
        """Update the bar; the library calls this after each step."""
        callbacks = load("stable_baselines3.common.callbacks", "rl")

        def advance(_locals: Any, _globals: Any) -> bool:
            self._progress.advance(self._task)
            return True

        return callbacks.ConvertCallback(advance)
