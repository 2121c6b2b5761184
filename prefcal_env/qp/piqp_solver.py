"""PIQP, a proximal interior-point solver: the QP solver, and the only import of piqp.

PIQP reports few errors: rows without a bound only print a message, NaN and an indefinite P pass
unnoticed, `solve` after a failed `setup` ends the process, and `result.x` is a view into memory
that the next solve overwrites. Therefore this adapter always sets up before it solves, and
`Solution.checked` copies and checks the result.
"""

from math import isfinite

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import QPError

from .problem import QP, Solution, Tolerances


class PIQPSolver:
    """Dense PIQP. One object may solve any number of problems of any size.

    It never raises for an unsolvable QP: read `Solution.solved`. Later solves do not change a
    solution.

    Args:
        tolerances: When to stop; None for the default.
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
        solved = solver.solve() == self._is_solved
        result = solver.result
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
