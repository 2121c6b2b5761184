"""Describe tuning as reinforcement learning: a bandit whose episodes have one step."""

from typing import Any

import gymnasium as gym
import numpy as np
from jaxtyping import Float

OBSERVATION = np.ones((1, 1), np.float32)
"""Observation before every experiment; always the same, since each one starts from scratch."""

Array = np.ndarray[Any, Any]


class Bandit(gym.Env[Array, Array]):
    """An environment that only provides spaces; the agent takes the steps, one per query."""

    def __init__(self, n: int) -> None:
        self.observation_space = gym.spaces.Box(0.0, 1.0, (1,), np.float32)
        self.action_space = gym.spaces.Box(-1.0, 1.0, (n,), np.float32)


def rewards(values: Float[np.ndarray, " K"]) -> Float[np.ndarray, " K"]:
    """Return the reward of each score, shape (K,), from its rank: 1 is best, -1 worst.

    Ranks do not depend on the unit of the score, nor on outliers: interrupted runs of the CSTR
    score a thousand times as much as good ones.
    """
    below = np.array([np.mean(values < value) for value in values])
    equal = np.array([np.mean(values == value) for value in values])
    return np.asarray(1.0 - 2.0 * below - equal)


def actions(z: Float[np.ndarray, "K n"]) -> Array:
    """Return samples of the unit cube as actions in [-1, 1], float32, shape (K, n)."""
    scaled: Array = (2 * z - 1).astype(np.float32)
    return scaled


def sample(action: Array) -> Float[np.ndarray, " n"]:
    """Return the point of the unit cube for an action, shape (n,), clipped to the cube."""
    return np.clip((np.asarray(action, dtype=float) + 1) / 2, 0.0, 1.0)
