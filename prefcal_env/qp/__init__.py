"""Quadratic programs: one problem type, two backends, and checked solutions."""

from prefcal_env.errors import SettingsError

from .problem import QP as QP
from .problem import Backend as Backend
from .problem import Box as Box
from .problem import Solution as Solution
from .problem import Status as Status
from .problem import Tolerances as Tolerances

ACTIVE_SET = "active-set"
BACKENDS = (ACTIVE_SET, "piqp")


def make_backend(name: str = "piqp", tolerances: Tolerances | None = None) -> Backend:
    """Make the QP solver called `name`, one of `BACKENDS`.

    Raises:
        SettingsError: If the name is unknown.
    """
    if name == ACTIVE_SET:
        from .active_set_backend import ActiveSetBackend

        return ActiveSetBackend(tolerances)
    if name == "piqp":
        from .piqp_backend import PIQPBackend

        return PIQPBackend(tolerances)
    raise SettingsError(f"QP backend must be one of {BACKENDS}, got {name!r}")
