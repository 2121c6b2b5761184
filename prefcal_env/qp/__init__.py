"""Quadratic programs: their data, a solver, and checked solutions."""

from .problem import QP as QP
from .problem import Backend as Backend
from .problem import Box as Box
from .problem import Solution as Solution
from .problem import Tolerances as Tolerances


def make_backend(tolerances: Tolerances | None = None) -> Backend:
    """Make a QP solver."""
    from .piqp_backend import PIQPBackend  # imported here: load piqp only when needed

    return PIQPBackend(tolerances)
