"""`prefcal/Experiment-v0`: tune a controller of one's own on a plant, or a rig, of one's own."""

from collections.abc import Callable, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from jaxtyping import Float

from prefcal_env.errors import SettingsError
from prefcal_env.experiments.control import Controller
from prefcal_env.experiments.experiment import Channels, Experiment
from prefcal_env.experiments.panels import Panel
from prefcal_env.experiments.rollout import KPIs, rollout
from prefcal_env.knobs.knob import KnobSpace

from .rendering import makes
from .tuning_env import Run, TuningEnv, same_step_vector

EnvSource = gym.Env[Any, Any] | str | Callable[[], gym.Env[Any, Any]]
ControllerFactory = Callable[[Float[np.ndarray, " n"]], Controller]


class ClosedLoop:
    """A `Run`: the controller of θ drives the plant environment until the episode ends.

    Args:
        env: The plant environment, its id, or a function that makes it.
        controller: A fresh controller from a physical θ, shape (n,).
        kpis: Key performance indicators of the experiment by name.

    Raises:
        SettingsError: `env` or `controller` is none of these.
    """

    def __init__(
        self, env: EnvSource, controller: ControllerFactory, kpis: KPIs | None = None
    ) -> None:
        made = gym.make(env) if isinstance(env, str) else env
        if callable(made) and not isinstance(made, gym.Env):
            made = made()
        if not isinstance(made, gym.Env):
            raise SettingsError(f"env must be an environment, an id or a factory, got {env!r}")
        if not callable(controller):
            raise SettingsError(f"controller must make one from θ, got {controller!r}")
        self._env, self._controller, self.kpis = made, controller, kpis

    @property
    def channels(self) -> Channels | None:
        """Channels of its experiments; None if the environment does not say."""
        found = getattr(self._env.unwrapped, "channels", None)
        return found if isinstance(found, Channels) else None

    @property
    def signals(self) -> tuple[str, ...] | None:
        """Keys of the signals of its experiments; None if the environment does not say."""
        return getattr(self._env.unwrapped, "signals", None)

    def __call__(self, theta: Float[np.ndarray, " n"], seed: int = 0) -> Experiment:
        """Run θ, physical, shape (n,)."""
        return rollout(self._env, self._controller(theta), theta, seed=seed, kpis=self.kpis)


@makes(TuningEnv)
def experiment_env(
    space: KnobSpace,
    *,
    run: Run | None = None,
    env: EnvSource | None = None,
    controller: ControllerFactory | None = None,
    kpis: KPIs | None = None,
    score: Callable[[Experiment], float] | None = None,
    panels: Sequence[Panel] | None = None,
    render_mode: str | None = None,
) -> TuningEnv:
    """`prefcal/Experiment-v0`. Give either `run`, or `env` and `controller`.

    Args:
        space: The knobs.
        run: One experiment: `run(theta, seed=0)` with a physical θ, shape (n,).
        env: A plant environment (`PlantEnv`, say), its id, or a function that makes it.
        controller: A fresh controller from a physical θ, shape (n,).
        kpis: With `env`: key performance indicators of an experiment by name.
        score: Of an experiment, lower is better; without one the reward is 0.
        panels: What to draw.
        render_mode: None or "rgb_array".

    Raises:
        SettingsError: neither or both of the two ways to run an experiment.
    """
    closed_loop = env is not None and controller is not None
    partly = env is not None or controller is not None or kpis is not None
    if (run is None) != closed_loop or (run is not None and partly):
        raise SettingsError("give either run, or env and controller (and kpis, if wanted)")
    if run is None:
        assert env is not None
        assert controller is not None
        run = ClosedLoop(env, controller, kpis)
    return TuningEnv(space, run, score=score, panels=panels, render_mode=render_mode)


def experiment_vector(num_envs: int = 1, **kwargs: Any) -> gym.vector.SyncVectorEnv:
    """Several `prefcal/Experiment-v0`, without wasted steps (see `same_step_vector`)."""
    return same_step_vector("prefcal/Experiment-v0", num_envs, **kwargs)
