"""The steady state of a varied plant: it starts where its controller had brought it."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import PlantError
from prefcal_env.plants.plant import Plant

X = Float[np.ndarray, " n_x"]
U = Float[np.ndarray, " n_u"]
_STEPS, _EXACT, _RESTS, _NEAR = 30, 1e-13, 1e-9, 1e-5
"""Most steps of Newton's method; what counts as rest at once, as its last step, and as rest at all."""


def rest(
    plant: Plant, x: X, u: U, d: Float[np.ndarray, " n_d"], outputs: Sequence[int], aims: Sequence[float]
) -> tuple[X, U] | None:
    """Return a steady state at which some outputs have given values, or None.

    It is found by Newton's method from (x, u), with the smallest step if several would do.

    Args:
        plant: Plant.
        x: State near it, shape (n_x,).
        u: Input near it, shape (n_u,).
        d: Measured disturbances.
        outputs: Indices of outputs, at most as many as inputs.
        aims: Their values.
    """
    x, u, n, chosen = np.array(x, dtype=float), np.array(u, dtype=float), len(x), list(outputs)
    scale = 1.0 + np.abs(np.concatenate([x, u]))
    for _ in range(_STEPS):
        try:
            J = plant.jacobians(x, u, d)
            left = np.concatenate([plant.f(x, u, d), plant.g(x, u, d)[chosen] - aims])
        except (ArithmeticError, PlantError):
            return None
        rows = np.block([[J.A, J.B], [J.C[chosen], J.D[chosen]]])
        if not (np.isfinite(rows).all() and np.isfinite(left).all()):
            return None
        if np.all(np.abs(left) <= _EXACT * (1 + np.abs(rows) @ scale)):
            return x, u
        step = scale * np.linalg.lstsq(rows * scale, -left, rcond=1e-12)[0]
        x, u = x + step[:n], u + step[n:]
        if np.abs(step / scale).max() <= _RESTS:
            near = np.abs(left) <= _NEAR * (1 + np.abs(rows) @ scale)
            return (x, u) if near.all() else None
    return None


def at_rest(plant: Plant, x: X, u: U, d: Float[np.ndarray, " n_d"]) -> bool:
    """Return whether a plant hardly moves at a point, in its unit of time."""
    return bool(np.abs(plant.f(x, u, d)).max(initial=0.0) <= _NEAR * (1 + np.abs(x).max(initial=0.0)))
