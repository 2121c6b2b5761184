"""DAQP, a dual active-set solver: the second backend, and the only import of daqp (an extra)."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import MissingExtraError

from .problem import QP, Box, Solution, Status, Tolerances, failed, verified

try:
    import daqp
except ImportError as error:  # pragma: no cover - the test environment has the extra
    raise MissingExtraError(
        "the QP backend 'daqp' is not installed: pip install 'prefcal[daqp]'"
    ) from error

_STATUS = {-1: Status.INFEASIBLE, -3: Status.UNBOUNDED, -4: Status.ITERATION_LIMIT}
_INFINITY = 1e30  # DAQP ignores bounds beyond this


class DAQPBackend:
    """Dense DAQP. If P is only semidefinite, DAQP's proximal iterations solve the problem."""

    name = "daqp"

    def __init__(self, tolerances: Tolerances | None = None) -> None:
        self._tolerances = tolerances or Tolerances()

    def solve(self, qp: QP) -> Solution:
        """Solve a QP once; see `Backend`."""
        tolerances = self._tolerances
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
            return failed(qp, _STATUS.get(exit_flag, Status.FAILED), iterations)
        return verified(qp, np.asarray(z), np.asarray(info["lam"]), iterations)

    def solve_boxes(self, boxes: Sequence[Box]) -> list[Float[np.ndarray, " n"] | None]:
        """Solve over boxes; see `Backend`."""
        problems = [QP(b.P, b.q, np.eye(len(b.q)), np.zeros(len(b.q)), b.upper) for b in boxes]
        solutions = [self.solve(problem) for problem in problems]
        return [solution.z if solution.solved else None for solution in solutions]
