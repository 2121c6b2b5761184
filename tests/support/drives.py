"""Experiments of the car without a car: a decision at every instant but the last."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from prefcal_env.envs.overtake.scene import Obstacle, signals_of
from prefcal_env.experiments.experiment import Channels, End, Experiment
from prefcal_env.plants.bicycle import KMH, Bicycle


def drive(
    *,
    T_s: float = 0.1,
    x_f: Sequence[float] | None = None,
    y_f: Sequence[float] | None = None,
    yaw: Sequence[float] | None = None,
    v: Any = None,
    steering: Any = None,
    phase: Sequence[int] | None = None,
    obstacle: tuple[float, float] = (90.0, 0.0),
    end: End = End.TIME_UP,
    theta: Sequence[float] = (0.31, 16.0, 0.261, 0.918),
) -> Experiment:
    """The states and inputs given, else lane keeping; the obstacle stands at (x, y)."""
    K = next((len(s) for s in (x_f, y_f, yaw, v, steering, phase) if s is not None), 5)
    zero = np.zeros(K)
    states = [zero if s is None else np.array(s, dtype=float) for s in (x_f, y_f, yaw)]
    speed = np.full(K, 50 * KMH) if v is None else np.array(v)
    u = np.column_stack([speed, zero if steering is None else steering])
    x, t = np.column_stack(states), T_s * np.arange(K)
    phases = zero if phase is None else np.array(phase, dtype=float)
    plant, steps = Bicycle(), K - 1
    return Experiment(
        theta=np.array([T_s, *theta]),
        t=t,
        x=x,
        u=u,
        t_control=t[:-1],
        u_control=u[:-1],
        y_ref=np.zeros((steps, 3)),
        iterations=np.full(steps, 10),
        solve_time=np.zeros(steps),
        solved=np.ones(steps, bool),
        channels=Channels(plant.states, plant.inputs, plant.outputs),
        end=end,
        signals=signals_of(t, x, phases, (Obstacle(*obstacle, speed=0.0),)),
    )
