"""Use, save and load a control law that was learned on a plant."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, final

import gymnasium as gym
import numpy as np

from prefcal_agents.support.extras import load as load_extra
from prefcal_env.errors import SettingsError
from prefcal_env.experiments.control import Controller, Measurement, Move

from .library import stable_baselines

Array = np.ndarray[Any, Any]
ALGORITHMS = ("PPO", "SAC")
_ORIGIN = "prefcal_origin"  # attribute of the model that the library saves with it


@dataclass(frozen=True, slots=True)
class Origin:
    """The origin of a policy.

    Args:
        algorithm: Name of the algorithm, one of `ALGORITHMS`.
        env_id: Id of the plant environment.
        T_s: Sampling time of the training, in the plant's unit of time.
        steps: Number of sampling periods of the training.
        seed: Seed of the training.
    """

    algorithm: str
    env_id: str
    T_s: float
    steps: int
    seed: int


@final
@dataclass(frozen=True, eq=False)
class TrainedPolicy:
    """A policy of stable-baselines3, used without its exploration noise.

    Args:
        model: Model of the library.
        origin: Training of the model.
    """

    model: Any
    origin: Origin

    def control(self, observation: Array) -> Array:
        """Return the action, inputs scaled to [-1, 1], for an observation of the plant."""
        action, _ = self.model.predict(observation, deterministic=True)
        return np.asarray(action)

    def controller(self, env: gym.Env[Any, Any]) -> Controller:
        """Return a controller in the plant environment `env`, for `rollout`.

        It sees only the environment's observation.

        Raises:
            SettingsError: If `env` cannot be observed apart from its steps.
        """
        plant: Any = env.unwrapped
        missing = [name for name in ("observe", "inputs") if not hasattr(plant, name)]
        if missing:
            raise SettingsError(f"a policy controls an environment with {missing}, got {plant!r}")
        return _PolicyController(self, plant)

    def save(self, path: str | Path) -> Path:
        """Save as a zip file of stable-baselines3 and return its path, which ends in .zip."""
        setattr(self.model, _ORIGIN, asdict(self.origin))
        target = Path(path)
        target = target if target.suffix == ".zip" else target.with_name(target.name + ".zip")
        self.model.save(target)
        return target

    @classmethod
    def load(cls, path: str | Path) -> "TrainedPolicy":
        """Load a file written by `save`. Only open files that you trust: they may contain code.

        Raises:
            SettingsError: If there is no such file, or it was not written by `save`.
            MissingExtraError: If the extra `rl` is not installed.
        """
        library = stable_baselines()
        saving = load_extra("stable_baselines3.common.save_util", "rl")
        try:
            data, _, _ = saving.load_from_zip_file(Path(path), device="cpu")
            origin = Origin(**data[_ORIGIN])
            model = getattr(library, origin.algorithm).load(Path(path), device="cpu")
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            raise SettingsError(f"no policy can be read from {str(path)!r}: {error}") from error
        return cls(model, origin)


@final
@dataclass(frozen=True)
class _PolicyController:
    policy: TrainedPolicy
    plant: Any

    @property
    def T_s(self) -> float:
        """Return the sampling time of the training."""
        return self.policy.origin.T_s

    def move(self, measurement: Measurement) -> Move:
        """Return the policy's move for the current state of the plant."""
        return Move(self.plant.inputs(self.policy.control(self.plant.observe())))
