"""What passes between a plant's environment and a controller, once a sampling period."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True, slots=True)
class Measurement:
    """What a controller knows at a sampling instant, in the plant's units.

    Args:
        t: Time since the start.
        x: State, measured or estimated, shape (n_x,).
        u: Input applied in the last sampling period, shape (n_u,).
        d: Measured disturbances, shape (n_d,); or their preview, one row a step, shape (N, n_d).
        y_ref: Output references, shape (n_y,); or their preview for y_1 ... y_N, shape (N, n_y).
    """

    t: float
    x: Float[np.ndarray, " n_x"]
    u: Float[np.ndarray, " n_u"]
    d: Float[np.ndarray, "*d"]
    y_ref: Float[np.ndarray, "*y"]


@dataclass(frozen=True, slots=True)
class Move:
    """What a controller decided.

    Args:
        u: Input to apply, shape (n_u,), in the plant's units.
        iterations: Of its solver, 0 where there is none.
        solved: False where the problem was not solved and the last input is held.
    """

    u: Float[np.ndarray, " n_u"]
    iterations: int = 0
    solved: bool = True


class Controller(Protocol):
    """A control law with its memory (an integrator, say), made fresh for each experiment."""

    @property
    def T_s(self) -> float:
        """Sampling time, in the plant's unit of time."""

    def move(self, measurement: Measurement) -> Move:
        """Decide the input of the coming sampling period."""
