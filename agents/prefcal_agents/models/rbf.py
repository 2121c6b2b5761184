"""Define the radial basis functions φ(εd) of eq. rbf and their distances.

All of them are smooth in u = (εd)², so value and slope are functions of u; the chain rule then
needs no division by a distance.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from jaxtyping import Float

Array = Float[np.ndarray, "..."]
_TINY = 1e-300  # keeps log(u) finite at a center


@dataclass(frozen=True, slots=True)
class RadialFunction:
    """φ as a function of u = (εd)²: `value` is φ, `slope` is dφ/du, both elementwise."""

    name: str
    value: Callable[[Array], Array]
    slope: Callable[[Array], Array]


def _thin_plate_spline(u: Array) -> Array:
    return np.asarray(0.5 * u * np.log(np.maximum(u, _TINY)))


RADIAL_FUNCTIONS: Mapping[str, RadialFunction] = MappingProxyType(
    {
        f.name: f
        for f in (
            RadialFunction("inverse_quadratic", lambda u: 1 / (1 + u), lambda u: -1 / (1 + u) ** 2),
            RadialFunction("gaussian", lambda u: np.exp(-u), lambda u: -np.exp(-u)),
            RadialFunction(
                "thin_plate_spline",
                _thin_plate_spline,
                lambda u: 0.5 * (np.log(np.maximum(u, _TINY)) + 1),
            ),
        )
    }
)
"""Radial functions of the paper by name."""


def squared_distances(
    a: Float[np.ndarray, "m n"], b: Float[np.ndarray, "N n"]
) -> Float[np.ndarray, "m N"]:
    """Return d of eq. distance between all rows of `a` and all of `b`, shape (m, N).

    Differences are taken before squaring: near the optimum samples lie within 1e-6 of each
    other, where |a|² + |b|² - 2ab has no correct digit.
    """
    d = np.zeros((len(a), len(b)))
    for k in range(a.shape[1]):
        difference = a[:, k, None] - b[:, k]
        d += difference * difference
    return d
