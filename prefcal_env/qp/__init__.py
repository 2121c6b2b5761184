"""Quadratic programs: their data, a solver, and checked solutions."""

from .problem import QP as QP
from .problem import PIQPSolver as PIQPSolver
from .problem import Solution as Solution
from .problem import Tolerances as Tolerances
