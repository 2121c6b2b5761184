"""DAQP, a dual active-set solver of others, to check our own with."""

import daqp
import numpy as np

from prefcal_env.qp import QP, Solution, Tolerances

_INFINITY = 1e30  # DAQP ignores bounds beyond this


class DAQPBackend:
    """Dense DAQP. If P is only semidefinite, DAQP's proximal iterations solve the problem."""

    def solve(self, qp: QP) -> Solution:
        """Solve a QP once; see `PIQPSolver`."""
        tolerances = Tolerances()
        z, _, exit_flag, info = daqp.solve(
            np.ascontiguousarray(qp.P),
            np.ascontiguousarray(qp.q),
            np.ascontiguousarray(qp.G),
            np.minimum(qp.upper, _INFINITY),
            np.maximum(qp.lower, -_INFINITY),
            primal_tol=max(tolerances.absolute, 1e-12),
            dual_tol=max(tolerances.absolute, 1e-12),
            iter_limit=max(tolerances.max_iterations, 4 * len(qp.lower)),
        )
        iterations = int(info["iterations"])
        if exit_flag != 1:
            return Solution.none(qp, iterations)
        return Solution.checked(qp, np.asarray(z), np.asarray(info["lam"]), iterations)
