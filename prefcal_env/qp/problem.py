"""Dense quadratic programs and their solutions."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import SettingsError


@dataclass(frozen=True, slots=True)
class Tolerances:
    """When a solver may stop: the QP tolerances that the paper lists among the MPC's knobs.

    Args:
        absolute: Tolerance of the residuals, in the units of each row and of the gradient.
        relative: Tolerance of the residuals, relative to the size of their terms.
        max_iterations: Number of iterations after which a solver gives up.
    """

    absolute: float = 1e-8
    relative: float = 1e-9
    max_iterations: int = 250

    def __post_init__(self) -> None:
        for name in ("absolute", "relative"):
            if not 0 <= getattr(self, name) < 1 or self.absolute + self.relative == 0:
                raise SettingsError(
                    f"{name} QP tolerance must be in [0, 1) and not both may be 0, got {getattr(self, name)}"
                )
        if self.max_iterations < 1:
            raise SettingsError(f"max_iterations must be 1 or more, got {self.max_iterations}")


@dataclass(frozen=True, slots=True)
class QP:
    """The problem min ½ zᵀP z + qᵀz subject to lower <= G z <= upper.

    Equal bounds define an equality. Nothing is checked: who makes it knows that it is convex.

    Args:
        P: Symmetric positive semidefinite matrix of the cost, shape (n, n).
        q: Linear term of the cost, shape (n,).
        G: Matrix of the rows, shape (m, n).
        lower: Lower bounds, shape (m,), -inf for no bound.
        upper: Upper bounds, shape (m,), inf for no bound.
    """

    P: Float[np.ndarray, "n n"]
    q: Float[np.ndarray, " n"]
    G: Float[np.ndarray, "m n"]
    lower: Float[np.ndarray, " m"]
    upper: Float[np.ndarray, " m"]


@dataclass(frozen=True, slots=True)
class Solution:
    """The result of a solve.

    Args:
        z: Minimizer, shape (n,); meaningful only if `solved`.
        multipliers: Multipliers of the rows of G, shape (m,), positive at the upper bound.
        iterations: Number of solver iterations.
        solved: Whether the solver found it, and its residuals passed the check.
    """

    z: Float[np.ndarray, " n"]
    multipliers: Float[np.ndarray, " m"]
    iterations: int
    solved: bool

    @classmethod
    def checked(
        cls, qp: QP, z: Float[np.ndarray, " n"], multipliers: Float[np.ndarray, " m"], iterations: int
    ) -> "Solution":
        """Return a solution that is "solved" only if the optimality conditions hold to 1e-6.

        The conditions are feasibility, stationarity and the duality gap, each relative to the size
        of its terms. `z` and `multipliers` are copied.
        """
        from ._kernels import TOLERANCE, residuals  # imported here: they load the compiler

        z, y = z.copy(), multipliers.copy()
        primal, reach, dual, force, gap, value = residuals(qp.P, qp.q, qp.G, qp.lower, qp.upper, z, y)
        good = primal <= TOLERANCE * reach and dual <= TOLERANCE * force
        return cls(z, y, iterations, bool(good and gap <= TOLERANCE * value))

    @classmethod
    def none(cls, qp: QP, iterations: int) -> "Solution":
        """Return that there is none."""
        return cls(np.full(len(qp.q), np.nan), np.full(len(qp.lower), np.nan), iterations, False)
