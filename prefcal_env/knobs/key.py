"""A θ as a key of dictionaries."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float


def theta_key(theta: Float[np.ndarray, " n"] | Sequence[float]) -> bytes:
    """Return the same bytes for equal θ, physical, shape (n,), whatever the sign of a zero."""
    return theta_keys(np.asarray(theta, dtype=float)[None])[0]


def theta_keys(thetas: Float[np.ndarray, "m n"]) -> list[bytes]:
    """Return the key of each of m physical θ, shape (m, n), as `theta_key` does of one."""
    return [theta.tobytes() for theta in thetas + 0.0]  # -0.0 + 0.0 is 0.0
