"""Tuning as reinforcement learning sees it: a bandit, whose episodes are of one step."""

from typing import Any

import gymnasium as gym
import numpy as np
from jaxtyping import Float

OBSERVATION = np.ones((1, 1), np.float32)
"""What is observed before every experiment: always the same, since each starts afresh."""

Array = np.ndarray[Any, Any]


class Bandit(gym.Env[Array, Array]):
    """The spaces that a model needs. Its steps are taken by the agent, a query at a time."""

    def __init__(self, n: int) -> None:
        self.observation_space = gym.spaces.Box(0.0, 1.0, (1,), np.float32)
        self.action_space = gym.spaces.Box(-1.0, 1.0, (n,), np.float32)


def rewards(values: Float[np.ndarray, " K"]) -> Float[np.ndarray, " K"]:
    """Reward of each score, shape (K,), from its rank among all of them: 1 is best, -1 worst.

    The unit of a score means nothing to a learning rate, and the CSTR's interrupted runs score a
    thousand times what good ones do.
    """
    below = np.array([np.mean(values < value) for value in values])
    equal = np.array([np.mean(values == value) for value in values])
    return np.asarray(1.0 - 2.0 * below - equal)


def actions(z: Float[np.ndarray, "K n"]) -> Array:
    """Samples of the unit cube as actions in [-1, 1], float32, shape (K, n)."""
    scaled: Array = (2 * z - 1).astype(np.float32)
    return scaled


def sample(action: Array) -> Float[np.ndarray, " n"]:
    """The point of the unit cube that an action, shape (n,), stands for; outside, its edge."""
    return np.clip((np.asarray(action, dtype=float) + 1) / 2, 0.0, 1.0)
