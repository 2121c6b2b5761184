"""Minimize the acquisition by a search from several starts.

It searches the unit cube or a box in it, respects integer knobs, takes the incumbent as one of its
starts, and returns points in increasing order of the objective, so that a caller who cannot use
the first takes the next.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float

Box = tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]

_SCALES = (1e-4, 0.3)  # smallest and largest step around the incumbent, in units of the cube
_APART = 0.1  # minimum distance between two starts of a descent, in the cube


@runtime_checkable
class Objective(Protocol):
    """A function to minimize: many values at once, and the gradient at one point."""

    def __call__(self, z: Float[np.ndarray, "m n"]) -> Float[np.ndarray, " m"]:
        """Return the values at the rows of `z`."""

    def gradient(self, z: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Return the gradient at one point."""


@dataclass(frozen=True, slots=True)
class Domain:
    """Region to search: a box in the unit cube, its fixed coordinates, and how points snap.

    Args:
        fixed: Mask of coordinates that a descent must not move (integer knobs), shape (n,).
        snap: Function that moves the rows of an array (m, n) to points that can run.
        start: Point to start from (the incumbent), shape (n,).
        corners: Lower and upper corner of the box to search, each of shape (n,).
    """

    fixed: Bool[np.ndarray, " n"]
    snap: Callable[[Float[np.ndarray, "m n"]], Float[np.ndarray, "m n"]] = field(repr=False)
    start: Float[np.ndarray, " n"]
    corners: Box


def multistart(
    objective: Objective,
    domain: Domain,
    rng: np.random.Generator,
    *,
    draws: int = 900,
    starts: int = 3,
    iterations: int = 40,
) -> Float[np.ndarray, "m n"]:
    """Sample the cube and the neighborhood of the incumbent, then descend from the best few.

    Source: none; it solves eq. xNp1 for every agent here.
    Deviation: L-BFGS-B with analytic gradients from sampled starts instead of the paper's particle
    swarm, also in `GLISp.paper`. Measured in docs/deviations.md.
    """
    points = _sampled(domain, rng, draws)
    values = objective(points)
    order = np.argsort(values, kind="stable")
    points, values = points[order], values[order]
    chosen = _apart(points, starts)
    descended = domain.snap(
        np.array([_descend(objective, domain, points[k], iterations) for k in chosen])
    )
    everything = np.vstack([descended, points])
    values = np.concatenate([objective(descended), values])
    return np.asarray(everything[np.argsort(values, kind="stable")])


def _sampled(domain: Domain, rng: np.random.Generator, draws: int) -> Float[np.ndarray, "m n"]:
    n, near = len(domain.start), draws // 3
    steps = np.exp(rng.uniform(np.log(_SCALES[0]), np.log(_SCALES[1]), size=(near, 1)))
    around = domain.start + steps * rng.standard_normal((near, n))
    low, high = domain.corners
    wide = low + (high - low) * rng.random((draws - near, n))
    return domain.snap(np.clip(np.vstack([domain.start[None], around, wide]), low, high))


def _apart(points: Float[np.ndarray, "m n"], count: int) -> list[int]:
    """Return the indices of the first `count` points that are far enough from each other."""
    chosen = [0]
    nearest = np.sum((points - points[0]) ** 2, axis=1)
    while len(chosen) < count:
        far = np.flatnonzero(nearest > _APART**2)
        if not len(far):
            break
        chosen.append(int(far[0]))
        nearest = np.minimum(nearest, np.sum((points - points[far[0]]) ** 2, axis=1))
    return chosen


def _descend(
    objective: Objective, domain: Domain, z: Float[np.ndarray, " n"], iterations: int
) -> Float[np.ndarray, " n"]:
    """Return the result of L-BFGS-B from `z` over the free coordinates, shape (n,)."""
    free = ~domain.fixed
    if not free.any():
        return z
    from scipy.optimize import minimize  # a third of a second to import

    point = z.copy()
    low, high = domain.corners

    def value_and_slope(part: np.ndarray) -> tuple[float, np.ndarray]:
        point[free] = part
        return float(objective(point[None])[0]), objective.gradient(point)[free]

    result = minimize(
        value_and_slope,
        z[free],
        jac=True,
        method="L-BFGS-B",
        bounds=list(zip(low[free], high[free], strict=True)),
        options={"maxiter": iterations},
    )
    point[free] = np.clip(result.x, low[free], high[free])
    return point
