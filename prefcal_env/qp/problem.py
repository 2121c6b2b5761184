"""Dense quadratic programs, their solutions, and PIQP, which solves them."""

from dataclasses import dataclass
from math import isfinite

import numpy as np
from jaxtyping import Float

from prefcal_env.arrays import integer
from prefcal_env.errors import QPError, SettingsError


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
        integer("max_iterations", self.max_iterations, low=1)
        object.__setattr__(self, "max_iterations", int(self.max_iterations))  # files have no NumPy


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
        from ._active_set import TOLERANCE, residuals  # imported here: they load the compiler

        z, y = z.copy(), multipliers.copy()
        primal, reach, dual, force, gap, value = residuals(qp.P, qp.q, qp.G, qp.lower, qp.upper, z, y)
        good = primal <= TOLERANCE * reach and dual <= TOLERANCE * force
        return cls(z, y, iterations, bool(good and gap <= TOLERANCE * value))

    @classmethod
    def none(cls, qp: QP, iterations: int) -> "Solution":
        """Return that there is none."""
        return cls(np.full(len(qp.q), np.nan), np.full(len(qp.lower), np.nan), iterations, False)


# --- PIQP, a proximal interior-point solver: the QP solver, and the only import of piqp.
#
# PIQP reports few errors: rows without a bound only print a message, NaN and an indefinite P pass
# unnoticed, `solve` after a failed `setup` ends the process, and `result.x` is a view into memory that
# the next solve overwrites. Therefore this adapter always sets up before it solves, and
# `Solution.checked` copies and checks the result.


class PIQPSolver:
    """Dense PIQP. One object may solve any number of problems of any size.

    It never raises for an unsolvable QP: read `Solution.solved`. Later solves do not change a
    solution.
    """

    def __init__(self, tolerances: Tolerances | None = None) -> None:
        import piqp  # here, so that only what solves a QP loads it

        tolerances = tolerances or Tolerances()
        self._solver, self._is_solved = piqp.DenseSolver(), piqp.PIQP_SOLVED
        settings = self._solver.settings
        settings.eps_abs = settings.eps_duality_gap_abs = tolerances.absolute
        settings.eps_rel = settings.eps_duality_gap_rel = tolerances.relative
        settings.max_iter = tolerances.max_iterations

    def solve(self, qp: QP) -> Solution:
        """Solve a QP once, and check the residuals. One that is not finite is not solved."""
        whole = np.isfinite(qp.G).all() and np.isfinite(qp.P).all() and np.isfinite(qp.q).all()
        if not whole or np.isnan(qp.lower).any() or np.isnan(qp.upper).any():
            return Solution.none(qp, 0)
        P = np.asfortranarray(qp.P.T)  # symmetric, so this makes no copy
        solver = self._solver
        bounded = np.isfinite(qp.lower) | np.isfinite(qp.upper)  # PIQP prints about others
        lower, upper = qp.lower[bounded], qp.upper[bounded]
        if len(lower):
            solver.setup(P, qp.q, None, None, np.asfortranarray(qp.G[bounded]), lower, upper)
        else:
            solver.setup(P, qp.q)
        solved, result = solver.solve() == self._is_solved, solver.result
        iterations = int(result.info.iter)
        if not solved:
            return Solution.none(qp, iterations)
        multipliers = np.zeros(len(bounded))
        multipliers[bounded] = result.z_u - result.z_l
        return Solution.checked(qp, result.x, multipliers, iterations)

    def solve_box(
        self, P: Float[np.ndarray, "n n"], q: Float[np.ndarray, " n"], upper: Float[np.ndarray, " n"]
    ) -> Float[np.ndarray, " n"] | None:
        """Minimize ½ zᵀP z + qᵀz over 0 <= z <= upper; None if it is not solved.

        For callers that know P, shape (n, n), to be positive definite: neither that nor the
        residuals are checked.

        Raises:
            QPError: If data is NaN or infinite.
        """
        if not isfinite(P.sum() + q.sum() + upper.sum()):
            raise QPError("P, q and upper of a QP must be finite")
        if len(q) <= 1:  # PIQP takes no problem of one variable with bounds only
            return np.clip(-q / np.diag(P), 0.0, upper)
        solver = self._solver
        solver.setup(np.asfortranarray(P.T), q, x_l=np.zeros(len(q)), x_u=upper)
        return np.array(solver.result.x) if solver.solve() == self._is_solved else None
