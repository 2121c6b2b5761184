"""A linear system with two inputs, and a controller that holds them, for tests of plants."""

import numpy as np

from prefcal_env import Move, PlantEnv, Task, rollout

A, B = np.array([[-1.0, 0.5], [0.2, -2.0]]), np.array([[1.0, 0.0], [0.3, 2.0]])
C, D = np.array([[1.0, 0.0], [0.5, 1.0]]), np.array([[0.0, 0.1], [0.0, 0.0]])


class Held:
    """A controller that applies one input for ever, and keeps what it measures."""

    def __init__(self, u, T_s):
        self.u, self.T_s, self.seen = np.atleast_1d(np.asarray(u, float)), T_s, []

    def move(self, m):
        self.seen.append((m.t, m.y.copy()))
        return Move(self.u)


def driven(plant, controller, **task):
    n_y = len(plant.outputs)
    how = {"y_ref": np.zeros(n_y), "horizon": 4.0} | task
    return rollout(PlantEnv(plant, Task(x0=plant.x0, u0=plant.u0, **how)), controller, np.ones(1))
