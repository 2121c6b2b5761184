"""A dense quadratic program, its solution, and the protocol of what solves it."""

from dataclasses import dataclass, field
from enum import Enum
from functools import cache
from math import isfinite
from typing import Any, Protocol

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import QPError, SettingsError


class Status(Enum):
    """How a solve ended. Only SOLVED has passed the check of its residuals."""

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
        absolute: On the residuals, in the units of each row and of the gradient.
        relative: On the residuals, against the size of the terms that they are made of.
        max_iterations: After which a solve is given up.
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
    """min ½ zᵀP z + qᵀz subject to lower <= G z <= upper; equal bounds are an equality.

    Args:
        P: Symmetric positive semidefinite, shape (n, n).
        q: Shape (n,).
        G: Shape (m, n).
        lower: Shape (m,), -inf where there is no bound.
        upper: Shape (m,), inf where there is no bound.

    Raises:
        QPError: wrong shapes, NaN or infinite data, crossed bounds, P not symmetric or
            not positive semidefinite.
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
        """The same cost under other rows; the cost, checked already, is not checked again."""
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
    from . import _kernels  # the compiler is not loaded before it is needed

    return _kernels


def _check_convex(P: Float[np.ndarray, "n n"]) -> None:
    scale = max(float(np.abs(P).max()), 1e-300)
    if np.abs(P - P.T).max() > 1e-10 * scale:
        raise QPError("P of a QP must be symmetric")
    try:
        # Semidefinite up to rounding: the shift lets a zero eigenvalue pass.
        np.linalg.cholesky(P + 1e-10 * scale * np.eye(len(P)))
    except np.linalg.LinAlgError as error:
        smallest = float(np.linalg.eigvalsh(P)[0])
        raise QPError(
            f"P of a QP must be positive semidefinite, its smallest eigenvalue is {smallest:.3g}"
        ) from error


@dataclass(frozen=True, slots=True)
class Solution:
    """What a solve gave.

    Args:
        z: Search, shape (n,); meaningful when `status` is SOLVED.
        multipliers: Of the rows of G, shape (m,), positive at the upper bound.
        status: How it ended, after the check of the residuals.
        iterations: Of the solver.
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


class Backend(Protocol):
    """A QP solver. Never raises for an unsolvable QP: read `Solution.status`."""

    @property
    def name(self) -> str:
        """How people call it."""

    def solve(self, qp: QP) -> Solution:
        """Solve once, check the residuals, return copies that later solves leave alone."""


def verified(
    qp: QP,
    z: Float[np.ndarray, " n"],
    multipliers: Float[np.ndarray, " m"],
    iterations: int,
    tolerance: float = 1e-6,
) -> Solution:
    """Trust a solver's "solved" only if the optimality conditions hold to `tolerance`.

    Feasibility, stationarity and the duality gap, each relative to the size of its terms.
    Copies `z` and `multipliers`.
    """
    z, y = z.copy(), multipliers.copy()
    primal, reach, dual, force, gap, value = _kernels().residuals(
        qp.P, qp.q, qp.G, qp.lower, qp.upper, z, y
    )
    good = primal <= tolerance * reach and dual <= tolerance * force and gap <= tolerance * value
    return Solution(z, y, Status.SOLVED if good else Status.INACCURATE, iterations, primal, dual)


def failed(qp: QP, status: Status, iterations: int) -> Solution:
    """A solution that holds nothing but how it failed."""
    nan = float("nan")
    return Solution(
        np.full(len(qp.q), nan), np.full(len(qp.lower), nan), status, iterations, nan, nan
    )
