"""Our compiled active-set method as a backend; PIQP solves what it cannot."""

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
from jaxtyping import Float

from .piqp_backend import PIQPBackend
from .problem import QP, Box, Solution, Tolerances, verified


class ActiveSetBackend:
    """The method of `_active_set`, for QPs whose P has a Cholesky factor L.

    In w = Lᵀ z + L⁻¹ q the cost is ½|w|². If P has no such factor, or the solution does not pass
    the check of its residuals, PIQP solves the QP.
    """

    name = "active-set"

    def __init__(self, tolerances: Tolerances | None = None) -> None:
        self._tolerances = tolerances or Tolerances()
        self._other = PIQPBackend(tolerances)

    def solve(self, qp: QP) -> Solution:
        """Solve a QP once; see `Backend`."""
        try:
            L = np.linalg.cholesky(qp.P)
        except np.linalg.LinAlgError:
            return self._other.solve(qp)
        start = np.linalg.solve(L, qp.q)
        G = np.ascontiguousarray(np.linalg.solve(L, qp.G.T).T)
        shift, tolerances = G @ start, self._tolerances
        how, w, multipliers, iterations = _kernel().nearest(
            G, qp.lower + shift, qp.upper + shift,
            tolerances.absolute, tolerances.relative, tolerances.max_iterations,
        )  # fmt: skip
        if how == _kernel().SOLVED:
            z = np.linalg.solve(L.T, w - start)
            solution = verified(qp, z, multipliers, iterations)
            if solution.solved:
                return solution
        return self._other.solve(qp)

    def solve_boxes(self, boxes: Sequence[Box]) -> list[Float[np.ndarray, " n"] | None]:
        """Solve over boxes, by PIQP; see `Backend`."""
        return self._other.solve_boxes(boxes)


@cache
def _kernel() -> Any:
    from . import _active_set  # imported here: load the compiler only when needed

    return _active_set
