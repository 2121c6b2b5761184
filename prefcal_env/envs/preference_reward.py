"""Preferences as a reward, for learners that only understand rewards."""

from typing import Any

import gymnasium as gym
import numpy as np

from prefcal_env.errors import SettingsError
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.preferences.answer import Answer, Calibrator, Preference

Array = np.ndarray[Any, Any]


class PreferenceReward(gym.Wrapper[Array, Array, Array, Array], gym.utils.RecordConstructorArgs):
    """A wrapper that rewards an experiment by comparing it with the best one so far.

    The reward is +1 if the calibrator prefers the new experiment (which becomes the incumbent), -1
    if they prefer the incumbent, and 0 for a tie, an abstention and the very first experiment.

    The observation is the incumbent's θ, scaled like the action (zeros without an incumbent),
    because the reward depends on it. `reset(seed=...)` forgets the incumbent, `reset()` keeps it.
    Info also has `preference` (-1, 0 or 1; absent for an abstention) and `incumbent`, the best
    `Experiment` so far.

    Args:
        env: Tuning environment whose info has an `experiment`.
        calibrator: Calibrator that compares two experiments.

    Raises:
        SettingsError: If `calibrator` has no `prefer`; in `step`, if the info has no experiment.
        PreferenceError: If the calibrator's answer in `step` is not valid.
    """

    def __init__(self, env: gym.Env[Array, Array], calibrator: Calibrator[Experiment]) -> None:
        if not isinstance(calibrator, Calibrator):
            raise SettingsError(f"calibrator must have a method prefer, got {calibrator!r}")
        gym.utils.RecordConstructorArgs.__init__(self, calibrator=calibrator)
        super().__init__(env)
        self._calibrator = calibrator
        self._incumbent: Experiment | None = None
        self._where: Array = np.zeros(env.observation_space.shape or (), np.float32)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Prepare the next experiment; with a seed, forget the incumbent."""
        observation, info = self.env.reset(seed=seed, options=options)
        if seed is not None:
            self._incumbent, self._where = None, np.zeros_like(observation)
        return self._where.copy(), info

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Run the experiment of `action` and compare it with the incumbent."""
        observation, _, terminated, truncated, info = self.env.step(action)
        experiment = info.get("experiment")
        if not isinstance(experiment, Experiment):
            raise SettingsError("PreferenceReward needs an environment with info['experiment']")
        answer = Answer(None)
        if self._incumbent is not None:
            answer = Answer.of(self._calibrator.prefer(experiment, self._incumbent))
        if self._incumbent is None or answer.preference is Preference.CHALLENGER:
            self._incumbent, self._where = experiment, observation.copy()
        info = info | {"incumbent": self._incumbent}
        if answer.preference is not None:
            info["preference"] = int(answer.preference)
        reward = 0.0 if answer.preference is None else -float(answer.preference)
        return self._where.copy(), reward, terminated, truncated, info
