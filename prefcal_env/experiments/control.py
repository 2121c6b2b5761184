"""The data that an environment and a controller exchange once every sampling period."""

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True, slots=True)
class Measurement:
    """Everything that a controller knows at a sampling instant, in the plant's units.

    Args:
        t: Time since the start.
        x: State, measured or estimated, shape (n_x,). `PlantEnv` gives the true one.
        u: Input applied during the last sampling period, shape (n_u,).
        d: Measured disturbances, shape (n_d,), or their preview, one row for each step, (N, n_d).
        y_ref: Output references, shape (n_y,), or their preview for y_1 ... y_N, shape (N, n_y).
        y: Outputs as they are measured, with noise and dead time if the task has them, shape
            (n_y,); empty if the environment measures none.
    """

    t: float
    x: Float[np.ndarray, " n_x"]
    u: Float[np.ndarray, " n_u"]
    d: Float[np.ndarray, "*d"]
    y_ref: Float[np.ndarray, "*y"]
    y: Float[np.ndarray, " _"] = field(default_factory=lambda: np.zeros(0))


@dataclass(frozen=True, slots=True)
class Move:
    """The decision of a controller.

    Args:
        u: Input to apply, shape (n_u,), in the plant's units.
        iterations: Number of solver iterations; 0 if there is no solver.
        solved: Whether the problem was solved; if not, the last input is held.
    """

    u: Float[np.ndarray, " n_u"]
    iterations: int = 0
    solved: bool = True


class Controller(Protocol):
    """A control law with its memory (such as an integrator), made anew for each experiment."""

    @property
    def T_s(self) -> float:
        """Sampling time, in the plant's unit of time."""

    def move(self, measurement: Measurement) -> Move:
        """Decide the input for the next sampling period."""
