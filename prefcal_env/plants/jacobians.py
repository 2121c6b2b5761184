"""The arrays that a plant takes and returns, and the derivatives of its equations at one point."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

X = Float[np.ndarray, " n_x"]
U = Float[np.ndarray, " n_u"]
D = Float[np.ndarray, " n_d"]
Y = Float[np.ndarray, " n_y"]
Times = Float[np.ndarray, " K"]
States = Float[np.ndarray, "K n_x"]


@dataclass(frozen=True, slots=True)
class Jacobians:
    """Derivatives of f and g: A = ∂f/∂x, B = ∂f/∂u, C = ∂g/∂x, D = ∂g/∂u."""

    A: Float[np.ndarray, "n_x n_x"]
    B: Float[np.ndarray, "n_x n_u"]
    C: Float[np.ndarray, "n_y n_x"]
    D: Float[np.ndarray, "n_y n_u"]


class ExactEquation:
    """An equation of a plant that knows its exact derivatives: a function of another library."""

    def __call__(self, x: Any, u: Any, d: Any) -> Float[np.ndarray, " m"]:
        """Return the values at one point, shape (m,)."""
        raise NotImplementedError

    def jacobian(self, x: Any, u: Any, d: Any) -> Float[np.ndarray, "m n"]:
        """Return the derivatives with respect to (x, u), shape (m, n_x + n_u)."""
        raise NotImplementedError
