"""The derivatives of a plant's equations at one point."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True, slots=True)
class Jacobians:
    """Derivatives of f and g: A = ∂f/∂x, B = ∂f/∂u, C = ∂g/∂x, D = ∂g/∂u."""

    A: Float[np.ndarray, "n_x n_x"]
    B: Float[np.ndarray, "n_x n_u"]
    C: Float[np.ndarray, "n_y n_x"]
    D: Float[np.ndarray, "n_y n_u"]
