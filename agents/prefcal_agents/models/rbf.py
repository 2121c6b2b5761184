"""The surrogate Ĵ: radial basis functions φ(εd) and their sum around the samples (eq. rbf).

All φ are smooth in u = (εd)², so value and slope are functions of u; the chain rule then needs no
division by a distance.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from jaxtyping import Float

Array = Float[np.ndarray, "..."]
_TINY = 1e-300  # keeps log(u) finite at a center
_WIDEST = 16.0  # largest ratio between the scales of two knobs


@dataclass(frozen=True, slots=True)
class RadialFunction:
    """φ as a function of u = (εd)²: `value` is φ, `slope` is dφ/du, both elementwise."""

    value: Callable[[Array], Array]
    slope: Callable[[Array], Array]


RADIAL_FUNCTIONS: Mapping[str, RadialFunction] = MappingProxyType(
    {
        "inverse_quadratic": RadialFunction(lambda u: 1 / (1 + u), lambda u: -1 / (1 + u) ** 2),
        "gaussian": RadialFunction(lambda u: np.exp(-u), lambda u: -np.exp(-u)),
        "thin_plate_spline": RadialFunction(
            lambda u: 0.5 * u * np.log(np.maximum(u, _TINY)),
            lambda u: 0.5 * (np.log(np.maximum(u, _TINY)) + 1),
        ),
    }
)
"""Radial functions of the paper by name."""


def squared_distances(a: Float[np.ndarray, "m n"], b: Float[np.ndarray, "N n"]) -> Float[np.ndarray, "m N"]:
    """Return d of eq. distance between all rows of `a` and all of `b`, shape (m, N).

    Differences are taken before squaring: near the optimum samples lie within 1e-6 of each
    other, where |a|² + |b|² - 2ab has no correct digit.
    """
    d = np.zeros((len(a), len(b)))
    for k in range(a.shape[1]):
        difference = a[:, k, None] - b[:, k]
        d += difference * difference
    return d


@dataclass(frozen=True, slots=True)
class Shape:
    """The shape of φ(εd): ε, and the weight of each knob in d.

    Args:
        epsilon: Width parameter ε of eq. rbf, above 0, in the unit cube.
        scales: Factor on each coordinate before computing distances, shape (n,), with geometric
            mean 1; all 1 is eq. distance.
        rbf: Name of φ, a key of `RADIAL_FUNCTIONS`.
    """

    epsilon: float
    scales: tuple[float, ...]
    rbf: str = "inverse_quadratic"

    def rescaled(self, knob: int, factor: float) -> "Shape | None":
        """Return the shape in which `knob` counts `factor` as much; None if too far from others."""
        scales = np.array(self.scales)
        scales[knob] *= factor
        scales /= np.exp(np.mean(np.log(scales)))
        if scales.max() > _WIDEST * scales.min():
            return None
        return replace(self, scales=tuple(map(float, scales)))

    def distances(self, a: Float[np.ndarray, "m n"], b: Float[np.ndarray, "N n"]) -> Float[np.ndarray, "m N"]:
        """Return d between the scaled points, shape (m, N).

        Source: eq. distance.
        Deviation: knobs that matter more count more (scales other than 1), because one ε for all
        knobs, as in the paper, wastes experiments on knobs that hardly matter.
        """
        scales = np.array(self.scales)
        return squared_distances(a * scales, b * scales)

    def basis(self, a: Float[np.ndarray, "m n"], b: Float[np.ndarray, "N n"]) -> Float[np.ndarray, "m N"]:
        """Return φ(εd) of eq. rbf between all rows of `a` and all of `b`, shape (m, N)."""
        return self.bases(a, b, (self.epsilon,))[0]

    def bases(
        self, a: Float[np.ndarray, "m n"], b: Float[np.ndarray, "N n"], epsilons: Sequence[float]
    ) -> list[Float[np.ndarray, "m N"]]:
        """Return φ(εd) as `basis` does, for each of `epsilons` instead of the own ε."""
        d, value = self.distances(a, b), RADIAL_FUNCTIONS[self.rbf].value
        return [np.asarray(value((epsilon * d) ** 2)) for epsilon in epsilons]


@dataclass(frozen=True, slots=True)
class Surrogate:
    """The surrogate Ĵ of eq. rbf: N centers in the unit cube, weights β and the shape of φ."""

    centers: Float[np.ndarray, "N n"]
    beta: Float[np.ndarray, " N"]
    shape: Shape

    def __call__(self, z: Float[np.ndarray, "m n"]) -> Float[np.ndarray, " m"]:
        """Return Ĵ at the rows of `z`, shape (m, n), unit cube, as shape (m,)."""
        return np.asarray(self.shape.basis(z, self.centers) @ self.beta)

    def value_and_gradient(self, z: Float[np.ndarray, " n"]) -> tuple[float, Float[np.ndarray, " n"]]:
        """Return Ĵ and ∂Ĵ/∂z at one point of the cube, shape (n,)."""
        shape, away = self.shape, z - self.centers
        squared_scales = np.array(shape.scales) ** 2
        d = (away * away) @ squared_scales
        u, phi = (shape.epsilon * d) ** 2, RADIAL_FUNCTIONS[shape.rbf]
        # du/dz = ε² 2d ∂d/dz and ∂d/dz = 2 scales² (z - center).
        slope = ((4 * shape.epsilon**2 * self.beta * phi.slope(u) * d) @ away) * squared_scales
        return float(phi.value(u) @ self.beta), np.asarray(slope)

    @property
    def spread(self) -> float:
        """Return ΔĴ, the range of Ĵ over the samples, which normalizes eq. acquisition."""
        return float(np.ptp(self(self.centers)))
