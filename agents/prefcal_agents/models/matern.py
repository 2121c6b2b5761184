"""Compute the Matérn kernel of smoothness 5/2, with a length for each knob."""

import numpy as np
from jaxtyping import Float

SHORTEST, LONGEST = 0.03, 10.0
"""Bounds of a length, in units of the cube."""
_ROOT5 = np.sqrt(5.0)


def squares(a: Float[np.ndarray, "m n"], b: Float[np.ndarray, "N n"]) -> Float[np.ndarray, "n m N"]:
    """Return the squared differences of every knob."""
    return np.asarray((a.T[:, :, None] - b.T[:, None, :]) ** 2)


def matern(
    u: Float[np.ndarray, "n m N"],
) -> tuple[Float[np.ndarray, "m N"], Float[np.ndarray, "m N"]]:
    """Return the kernel, and twice its slope in Σ u, for squared differences u scaled by 1/ℓ².

    Source: C. E. Rasmussen, C. K. I. Williams, "Gaussian Processes for Machine Learning" (2006),
    equation 4.17.
    """
    r = np.sqrt(np.sum(u, axis=0))
    decay = np.exp(-_ROOT5 * r)
    return (1 + _ROOT5 * r + 5 / 3 * r * r) * decay, -5 / 3 * (1 + _ROOT5 * r) * decay
