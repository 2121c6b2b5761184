"""A dense quadratic program, its solution, and the protocol of a solver."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import Enum
from functools import cache
from math import isfinite
from typing import Any, Protocol

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import QPError, SettingsError


class Status(Enum):
    """How a solve ended. Only SOLVED means that the residuals passed the check."""

    SOLVED = "solved"
    INACCURATE = "residuals above tolerance"
    INFEASIBLE = "no feasible point"
    UNBOUNDED = "unbounded below"
    ITERATION_LIMIT = "iteration limit"
    FAILED = "numerical failure"


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
                    f"{name} QP tolerance must be in [0, 1) and not both may be 0, "
                    f"got {getattr(self, name)}"
                )
        if self.max_iterations < 1:
            raise SettingsError(f"max_iterations must be 1 or more, got {self.max_iterations}")


@dataclass(frozen=True, slots=True)
class QP:
    """The problem min ½ zᵀP z + qᵀz subject to lower <= G z <= upper.

    Equal bounds define an equality.

    Args:
        P: Symmetric positive semidefinite matrix of the cost, shape (n, n).
        q: Linear term of the cost, shape (n,).
        G: Matrix of the rows, shape (m, n).
        lower: Lower bounds, shape (m,), -inf for no bound.
        upper: Upper bounds, shape (m,), inf for no bound.

    Raises:
        QPError: If a shape is wrong, data is NaN or infinite, bounds are crossed, or P is not
            symmetric positive semidefinite.
    """

    P: Float[np.ndarray, "n n"]
    q: Float[np.ndarray, " n"]
    G: Float[np.ndarray, "m n"]
    lower: Float[np.ndarray, " m"]
    upper: Float[np.ndarray, " m"]
    has_free_rows: bool = field(init=False, default=False, compare=False)

    def __post_init__(self) -> None:
        n = len(self.q)
        if n == 0 or self.P.shape != (n, n) or self.q.shape != (n,):
            raise QPError(
                "the cost of a QP needs P (n, n) and q (n,) with n of 1 or more, "
                f"got {self.P.shape}, {self.q.shape}"
            )
        if not isfinite(self.P.sum() + self.q.sum()):
            raise QPError("P and q of a QP must be finite")
        _check_convex(self.P)
        self._check_rows()

    def under(
        self,
        G: Float[np.ndarray, "m2 n"],
        lower: Float[np.ndarray, " m2"],
        upper: Float[np.ndarray, " m2"],
    ) -> "QP":
        """Return the same cost with other rows; the cost is not checked again."""
        qp = object.__new__(QP)
        put = object.__setattr__
        put(qp, "P", self.P), put(qp, "q", self.q)
        put(qp, "G", G), put(qp, "lower", lower), put(qp, "upper", upper)
        qp._check_rows()
        return qp

    def _check_rows(self) -> None:
        m = len(self.lower)
        if self.G.shape != (m, len(self.q)) or self.lower.shape != self.upper.shape:
            raise QPError(
                f"the rows of a QP need G (m, {len(self.q)}), lower (m,) and upper (m,), got "
                f"{self.G.shape}, {self.lower.shape}, {self.upper.shape}"
            )
        if not m:
            object.__setattr__(self, "has_free_rows", False)
            return
        finite, crossed, free = _kernels().check_rows(self.G, self.lower, self.upper)
        if not finite:
            raise QPError("G of a QP must be finite")
        if crossed >= 0:
            raise QPError(
                f"lower must not be above upper: row {crossed} has "
                f"[{self.lower[crossed]}, {self.upper[crossed]}]"
            )
        object.__setattr__(self, "has_free_rows", free)


@cache
def _kernels() -> Any:
    from . import _kernels  # imported here: load the compiler only when needed

    return _kernels


def _check_convex(P: Float[np.ndarray, "n n"]) -> None:
    scale = max(float(np.abs(P).max()), 1e-300)
    if np.abs(P - P.T).max() > 1e-10 * scale:
        raise QPError("P of a QP must be symmetric")
    try:
        # Semidefinite up to rounding: the shift accepts an eigenvalue of zero.
        np.linalg.cholesky(P + 1e-10 * scale * np.eye(len(P)))
    except np.linalg.LinAlgError as error:
        smallest = float(np.linalg.eigvalsh(P)[0])
        raise QPError(
            f"P of a QP must be positive semidefinite, its smallest eigenvalue is {smallest:.3g}"
        ) from error


@dataclass(frozen=True, slots=True)
class Solution:
    """The result of a solve.

    Args:
        z: Minimizer, shape (n,); meaningful only if `status` is SOLVED.
        multipliers: Multipliers of the rows of G, shape (m,), positive at the upper bound.
        status: How the solve ended, after the check of the residuals.
        iterations: Number of solver iterations.
        primal_residual: Largest violation of a row.
        dual_residual: Largest entry of P z + q + Gᵀ multipliers.
    """

    z: Float[np.ndarray, " n"]
    multipliers: Float[np.ndarray, " m"]
    status: Status
    iterations: int
    primal_residual: float
    dual_residual: float

    @property
    def solved(self) -> bool:
        """Whether `z` may be used."""
        return self.status is Status.SOLVED


@dataclass(frozen=True, slots=True)
class Box:
    """The problem min ½ zᵀP z + qᵀz subject to 0 <= z <= upper, with a P that is known to be fine.

    Args:
        P: Symmetric positive definite matrix of the cost, shape (n, n).
        q: Linear term of the cost, shape (n,).
        upper: Upper bounds, 0 or more, shape (n,).
    """

    P: Float[np.ndarray, "n n"]
    q: Float[np.ndarray, " n"]
    upper: Float[np.ndarray, " n"]


class Backend(Protocol):
    """A QP solver. It never raises for an unsolvable QP: read `Solution.status`."""

    def solve(self, qp: QP) -> Solution:
        """Solve once, check the residuals, and return copies that later solves do not change."""

    def solve_boxes(self, boxes: Sequence[Box]) -> list[Float[np.ndarray, " n"] | None]:
        """Solve many small problems over boxes; None for each one that is not solved.

        For callers that know P to be positive definite: neither that nor the residuals are
        checked.

        Raises:
            QPError: If data is NaN or infinite.
        """


def verified(
    qp: QP,
    z: Float[np.ndarray, " n"],
    multipliers: Float[np.ndarray, " m"],
    iterations: int,
) -> Solution:
    """Return a solution that is "solved" only if the optimality conditions hold to 1e-6.

    The conditions are feasibility, stationarity and the duality gap, each relative to the size of
    its terms. `z` and `multipliers` are copied.
    """
    z, y = z.copy(), multipliers.copy()
    primal, reach, dual, force, gap, value = _kernels().residuals(
        qp.P, qp.q, qp.G, qp.lower, qp.upper, z, y
    )
    tolerance = _kernels().TOLERANCE
    good = primal <= tolerance * reach and dual <= tolerance * force and gap <= tolerance * value
    return Solution(z, y, Status.SOLVED if good else Status.INACCURATE, iterations, primal, dual)


def failed(qp: QP, status: Status, iterations: int) -> Solution:
    """Return a solution that only says how the solve failed."""
    nan = float("nan")
    return Solution(
        np.full(len(qp.q), nan), np.full(len(qp.lower), nan), status, iterations, nan, nan
    )
