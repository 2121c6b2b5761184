"""The law of the sampled PID, written once: for the controller that runs and for linear loops."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_env.plants.systems import LinearSystem


@dataclass(frozen=True, slots=True)
class Tuning:
    """Parameters of a PID: gain with its sign, and integral and derivative time."""

    K_p: float
    T_i: float
    T_d: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class PIDLaw:
    """Coefficients of the sampled PID, each a number, or an array for several PIDs.

    u_k = K_p (b r_k - y_k) + I_k + D_k with I_{k+1} = I_k + integral (r_k - y_k) and
    D_k = pole (D_{k-1} + rise (e_k - e_{k-1})), where e = c r - y.
    """

    K_p: Any
    integral: Any
    pole: Any
    rise: Any

    @classmethod
    def of(cls, K_p: Any, T_i: Any, T_d: Any, *, N: float, T_s: float) -> "PIDLaw":
        """Return the law for the parameters of `PID`."""
        return cls(K_p, K_p * T_s / T_i, T_d / (T_d + N * T_s), K_p * N)

    @property
    def of_output(self) -> tuple[Any, Any]:
        """Gains of y in a form with the states I_k and s_k: the one on u, and the one on s.

        u_k = direct y_k + I_k + s_k and s_{k+1} = pole s_k + slope y_k, for r = 0.
        """
        lead = self.pole * self.rise
        return -self.K_p - lead, lead * (1 - self.pole)

    def at(self, z: Any) -> Any:
        """Return C(z), from the error to the input (c = 1), at points of the z plane."""
        direct, slope = self.of_output
        return -direct + self.integral / (z - 1) - slope / (z - self.pole)


@dataclass(frozen=True, slots=True, eq=False)
class LinearPIDs:
    """Sets of PIDs to check together: m sets, each with p PIDs side by side.

    PID i of a set goes from output i to input i of a square plant.

    Args:
        K_p: Gains, shape (m, p).
        T_i: Integral times, shape (m, p).
        T_d: Derivative times, shape (m, p).
        N: Filter of the derivatives, as in `PID`.
    """

    K_p: Float[np.ndarray, "m p"]
    T_i: Float[np.ndarray, "m p"]
    T_d: Float[np.ndarray, "m p"]
    N: float

    @classmethod
    def of(cls, tunings: Sequence[Tuning], N: float) -> "LinearPIDs":
        """Return one set of PIDs."""
        K_p, T_i, T_d = np.array([(t.K_p, t.T_i, t.T_d) for t in tunings]).T[:, None]
        return cls(K_p, T_i, T_d, N)

    def loops(self, plant: LinearSystem) -> Float[np.ndarray, "m n n"]:
        """Return the closed loops, x⁺ = M x; x holds the plant's states, then I, then s."""
        law, p, n = self._law(plant.dt), self.K_p.shape[1], len(plant.A)
        direct, slope = law.of_output
        M = np.zeros((len(self.K_p), n + 2 * p, n + 2 * p))
        M[:, :n, :n] = plant.A + (plant.B * direct[:, None, :]) @ plant.C
        M[:, :n, n : n + p] = M[:, :n, n + p :] = plant.B
        M[:, n : n + p, :n] = -law.integral[:, :, None] * plant.C
        M[:, n + p :, :n] = slope[:, :, None] * plant.C
        k = np.arange(p)
        M[:, n + k, n + k], M[:, n + p + k, n + p + k] = 1.0, law.pole
        return M

    def drive(self, plant: LinearSystem) -> Float[np.ndarray, "n 2"]:
        """Return what a unit step of reference (b = 1) and of load add to x of the first loop.

        For one PID.
        """
        law, n = self._law(plant.dt), len(plant.A)
        drive = np.zeros((n + 2, 2))
        drive[:n] = np.column_stack([plant.B[:, 0] * law.K_p[0, 0], plant.B[:, 0]])
        drive[n, 0] = law.integral[0, 0]
        return drive

    def stable(self, plant: LinearSystem) -> np.ndarray:
        """Return whether all poles of each closed loop are within the unit circle, shape (m,)."""
        return np.asarray(np.abs(np.linalg.eigvals(self.loops(plant))).max(axis=1) < 1 - 1e-9)

    def sensitivity(self, plant: LinearSystem, omega: Float[np.ndarray, " k"]) -> np.ndarray:
        """Return max σ((1 + G C)^-1) over `omega`, infinite for unstable loops, shape (m,).

        Source: Skogestad, Postlethwaite, Multivariable Feedback Control.
        """
        z = np.exp(1j * omega * plant.dt)[:, None]
        C = self._law(plant.dt, each=True).at(z)  # (m, k, p)
        difference = np.eye(self.K_p.shape[1]) + plant.at(1j * omega) * C[:, :, None, :]
        if difference.shape[-1] == 1:
            least = np.abs(difference[..., 0, 0]).min(axis=1)
        else:
            least = np.linalg.svd(difference, compute_uv=False)[..., -1].min(axis=1)
        with np.errstate(divide="ignore"):
            return np.where(self.stable(plant), 1 / least, np.inf)

    def _law(self, T_s: float, *, each: bool = False) -> PIDLaw:
        """Return the law of each PID, shape (m, p); with `each` for every frequency, (m, 1, p)."""
        parameters = (v[:, None] if each else v for v in (self.K_p, self.T_i, self.T_d))
        return PIDLaw.of(*parameters, N=self.N, T_s=T_s)
