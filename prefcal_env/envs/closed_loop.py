"""A plant and a controller as a function from θ to an experiment."""

from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
from jaxtyping import Float

from prefcal_env.errors import SettingsError
from prefcal_env.experiments.control import Controller
from prefcal_env.experiments.experiment import Channels, Experiment, KPIs
from prefcal_env.experiments.rollout import rollout

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

    def __init__(self, env: EnvSource, controller: ControllerFactory, kpis: KPIs | None = None) -> None:
        made = gym.make(env) if isinstance(env, str) else env
        if callable(made) and not isinstance(made, gym.Env):
            made = made()
        if not isinstance(made, gym.Env):
            raise SettingsError(f"env must be an environment, an id or a factory, got {env!r}")
        if not callable(controller):
            raise SettingsError(f"controller must be a function of θ, got {controller!r}")
        self._env, self.controller, self.kpis = made, controller, kpis

    @property
    def env(self) -> gym.Env[Any, Any]:
        """Environment that the controllers drive, without its wrappers."""
        return self._env.unwrapped

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
