"""A θ as a key of dictionaries."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float


def theta_key(theta: Float[np.ndarray, " n"] | Sequence[float]) -> bytes:
    """Return the same bytes for equal θ, physical, shape (n,), whatever the sign of a zero."""
    return bytes((np.asarray(theta, dtype=float) + 0.0).tobytes())  # -0.0 + 0.0 is 0.0
