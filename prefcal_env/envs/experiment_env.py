"""`prefcal/Experiment-v0`: tune your own controller on your own plant or rig."""

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
from prefcal_env.knobs.space import KnobSpace

from .rendering import makes
from .tuning_env import Run, TuningEnv, same_step_vector

EnvSource = gym.Env[Any, Any] | str | Callable[[], gym.Env[Any, Any]]
ControllerFactory = Callable[[Float[np.ndarray, " n"]], Controller]


class ClosedLoop:
    """A `Run` that lets the controller of θ drive a plant environment until the episode ends.

    Args:
        env: Plant environment, its id, or a function that makes it.
        controller: Function that makes a new controller from a physical θ, shape (n,).
        kpis: Function that returns the key performance indicators of an experiment by name.

    Raises:
        SettingsError: If `env` or `controller` is none of these.
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
            raise SettingsError(f"controller must be a function of θ, got {controller!r}")
        self._env, self.controller, self.kpis = made, controller, kpis

    @property
    def channels(self) -> Channels | None:
        """Channels of the experiments; None if the environment does not define them."""
        found = getattr(self._env.unwrapped, "channels", None)
        return found if isinstance(found, Channels) else None

    @property
    def signals(self) -> tuple[str, ...] | None:
        """Keys of the experiments' signals; None if the environment does not define them."""
        return getattr(self._env.unwrapped, "signals", None)

    def __call__(self, theta: Float[np.ndarray, " n"], seed: int = 0) -> Experiment:
        """Run a physical θ, shape (n,)."""
        return rollout(self._env, self.controller(theta), theta, seed=seed, kpis=self.kpis)


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
    """Make `prefcal/Experiment-v0`. Give either `run`, or `env` and `controller`.

    Args:
        space: Space of the knobs.
        run: Function that runs one experiment: `run(theta, seed=0)` with a physical θ, shape (n,).
        env: Plant environment (such as `PlantEnv`), its id, or a function that makes it.
        controller: Function that makes a new controller from a physical θ, shape (n,).
        kpis: With `env`: function that returns the key performance indicators by name.
        score: Function that rates an experiment, lower is better; without it the reward is 0.
        panels: Curves to draw.
        render_mode: None or "rgb_array".

    Raises:
        SettingsError: If neither or both ways of running an experiment are given.
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
    """Make several `prefcal/Experiment-v0`, without wasted steps (see `same_step_vector`)."""
    return same_step_vector("prefcal/Experiment-v0", num_envs, **kwargs)
