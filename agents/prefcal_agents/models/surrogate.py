"""Define the surrogate Ĵ: a sum of radial basis functions around the samples (eq. rbf)."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from .kpi_model import KPIModel
from .rbf import RADIAL_FUNCTIONS, squared_distances


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

    def distances(
        self, a: Float[np.ndarray, "m n"], b: Float[np.ndarray, "N n"]
    ) -> Float[np.ndarray, "m N"]:
        """Return d between the scaled points, shape (m, N).

        Source: eq. distance.
        Deviation: knobs that matter more count more (scales other than 1), because one ε for all
        knobs, as in the paper, wastes experiments on knobs that hardly matter.
        """
        scales = np.array(self.scales)
        return squared_distances(a * scales, b * scales)

    def basis(
        self, a: Float[np.ndarray, "m n"], b: Float[np.ndarray, "N n"]
    ) -> Float[np.ndarray, "m N"]:
        """Return φ(εd) of eq. rbf between all rows of `a` and all of `b`, shape (m, N)."""
        u = (self.epsilon * self.distances(a, b)) ** 2
        return np.asarray(RADIAL_FUNCTIONS[self.rbf].value(u))

    def gradient(
        self,
        z: Float[np.ndarray, " n"],
        centres: Float[np.ndarray, "N n"],
        beta: Float[np.ndarray, " N"],
    ) -> Float[np.ndarray, " n"]:
        """Return ∂/∂z of Σ β_i φ(εd(z, center i)) at one point, shape (n,)."""
        squared_scales = np.array(self.scales) ** 2
        away = z - centres
        d = (away * away) @ squared_scales
        slope = RADIAL_FUNCTIONS[self.rbf].slope((self.epsilon * d) ** 2)
        # du/dz = ε² 2d ∂d/dz and ∂d/dz = 2 scales² (z - center).
        return np.asarray(((4 * self.epsilon**2 * beta * slope * d) @ away) * squared_scales)


@dataclass(frozen=True, slots=True)
class Surrogate:
    """The surrogate Ĵ of eq. rbf: N centers in the unit cube, weights β and the shape of φ."""

    centres: Float[np.ndarray, "N n"]
    beta: Float[np.ndarray, " N"]
    shape: Shape

    def __call__(self, z: Float[np.ndarray, "m n"]) -> Float[np.ndarray, " m"]:
        """Return Ĵ at the rows of `z`, shape (m, n), unit cube, as shape (m,)."""
        return np.asarray(self.shape.basis(z, self.centres) @ self.beta)

    def gradient(self, z: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Return ∂Ĵ/∂z at one point of the cube, shape (n,)."""
        return self.shape.gradient(z, self.centres, self.beta)

    @property
    def spread(self) -> float:
        """Return ΔĴ, the range of Ĵ over the samples, which normalizes eq. acquisition."""
        return float(np.ptp(self(self.centres)))


@dataclass(frozen=True, slots=True)
class Composite:
    """The surrogate Ĵ of eq. rbf plus a part from KPIs.

    Source: none.
    Deviation: what a person prefers depends on what happened, not on θ.
    """

    over_theta: Surrogate
    over_kpis: KPIModel

    @property
    def centres(self) -> Float[np.ndarray, "N n"]:
        """Return the samples in the unit cube, shape (N, n)."""
        return self.over_theta.centres

    def __call__(self, z: Float[np.ndarray, "m n"]) -> Float[np.ndarray, " m"]:
        """Return Ĵ at the rows of `z`, shape (m, n), unit cube, as shape (m,)."""
        return np.asarray(self.over_theta(z) + self.over_kpis(z))

    def gradient(self, z: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Return ∂Ĵ/∂z at one point of the cube, shape (n,)."""
        return np.asarray(self.over_theta.gradient(z) + self.over_kpis.gradient(z))

    @property
    def spread(self) -> float:
        """Return ΔĴ, the range of Ĵ over the samples."""
        return float(np.ptp(self(self.centres)))
