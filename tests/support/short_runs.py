"""Experiments without a plant: one state that stays at a value."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from prefcal_env.experiments.experiment import Channel, Channels, End, Experiment

CHANNELS = Channels(x=(Channel("level", "m"),), u=(Channel("valve", "%"),), y=(Channel("level"),))


def short_run(
    theta: Sequence[float],
    *,
    value: float = 1.0,
    duration: float = 1.0,
    end: End = End.TIME_UP,
    **changes: Any,
) -> Experiment:
    """An experiment of two steps in which the level is `value`."""
    fields: dict[str, Any] = {
        "theta": np.array(theta, dtype=float),
        "t": np.array([0.0, duration / 2, duration]),
        "x": np.full((3, 1), value),
        "u": np.zeros((3, 1)),
        "t_control": np.array([0.0, duration / 2]),
        "u_control": np.zeros((2, 1)),
        "y_ref": np.zeros((2, 1)),
        "iterations": np.zeros(2, dtype=int),
        "solve_time": np.zeros(2),
        "solved": np.ones(2, dtype=bool),
        "channels": CHANNELS,
        "end": end,
    }
    return Experiment(**fields | changes)


def final_level(experiment: Experiment) -> float:
    """The level at the end, m."""
    return float(experiment.x[-1, 0])
