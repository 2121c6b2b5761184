"""Settings of an MPC of eq. MPC and eq. MPC_constraints, frozen and checked."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, fields
from typing import Any, Literal, get_args

import numpy as np

from prefcal_env.arrays import weights
from prefcal_env.errors import SettingsError
from prefcal_env.knobs.knob import is_number
from prefcal_env.qp import Tolerances

Linearization = Literal["point", "trajectory"]
ACTIVE_SET = "active-set"
BACKENDS = (ACTIVE_SET, "piqp")
Matrix = Sequence[Sequence[float]] | np.ndarray
Vector = Sequence[float] | np.ndarray


def _tuple(value: Any) -> Any:
    """Return arrays and lists as nested tuples, which are frozen and compare by value."""
    if isinstance(value, np.ndarray | list | tuple):
        return tuple(_tuple(v) for v in value)
    return float(value) if isinstance(value, np.floating | np.integer) else value


@dataclass(frozen=True)
class MPCSettings:
    """Settings of a linear (time-varying) MPC. Matrices and vectors may be given as arrays.

    Args:
        T_s: Sampling time, in the plant's unit of time.
        N_p: Prediction horizon, steps.
        N_u: Number of free moves, steps; afterwards the input is held. At most N_p.
        Q_y: Weight of y - y_ref, shape (n_y, n_y), positive semidefinite.
        Q_du: Weight of the moves Δu, shape (n_u, n_u), positive semidefinite.
        Q_u: Weight of u - u_ref, shape (n_u, n_u), positive semidefinite; None means zero.
        u_ref: Input reference, shape (n_u,) or (N, n_u), one row for each step; None means zero.
        u_min: Hard lower limits of the inputs, shape (n_u,); None uses the plant's.
        u_max: Hard upper limits of the inputs, shape (n_u,); None uses the plant's.
        du_min: Hard lower limits of the move in one step, shape (n_u,); None for no limit.
        du_max: Hard upper limits of the move in one step, shape (n_u,); None for no limit.
        y_min: Soft lower limits of the outputs, shape (n_y,); None for no limit.
        y_max: Soft upper limits of the outputs, shape (n_y,); None for no limit.
        Q_eps: Weight of the single slack ε >= 0 of the soft limits, above 0.
        softness: Factor on ε by which each output's limits may be violated, shape (n_y,); None is
            1.
        linearization: "point" uses one model, at the present state and input, for the whole
            horizon. "trajectory" uses one along the nominal trajectory of the last plan (eq.
            MPCsys).
        backend: QP solver: "active-set", which is compiled into the step, or "piqp".
        tolerances: Tolerances of the QP solver.

    Raises:
        SettingsError: If a horizon is below 1 or not an integer, N_u is above N_p, the sampling
            time or Q_eps is not positive, a weight is not symmetric positive semidefinite, limits
            are crossed, or an option is unknown.
    """

    T_s: float
    N_p: int
    N_u: int
    Q_y: Matrix
    Q_du: Matrix
    Q_u: Matrix | None = None
    u_ref: Matrix | Vector | None = None
    u_min: Vector | None = None
    u_max: Vector | None = None
    du_min: Vector | None = None
    du_max: Vector | None = None
    y_min: Vector | None = None
    y_max: Vector | None = None
    Q_eps: float = 10.0
    softness: Vector | None = None
    linearization: Linearization = "point"
    backend: str = ACTIVE_SET
    tolerances: Tolerances = field(default_factory=Tolerances)

    def __post_init__(self) -> None:
        for f in fields(self):
            object.__setattr__(self, f.name, _tuple(getattr(self, f.name)))
        for name in ("T_s", "Q_eps"):
            if not (is_number(getattr(self, name)) and 0 < getattr(self, name) < np.inf):
                raise SettingsError(f"{name} must be positive, got {getattr(self, name)}")
        self._check_horizons()
        for name in ("Q_y", "Q_du", "Q_u"):
            if name != "Q_u" or self.Q_u is not None:
                weights(name, getattr(self, name))
        for what in ("u", "du", "y"):
            low, high = getattr(self, f"{what}_min"), getattr(self, f"{what}_max")
            if None not in (low, high) and not np.all(np.asarray(low) <= np.asarray(high)):
                raise SettingsError(f"{what}_min must not be above {what}_max, got {low}, {high}")
        if self.linearization not in get_args(Linearization):
            raise SettingsError(
                f"linearization must be one of {get_args(Linearization)}, got {self.linearization!r}"
            )
        if not isinstance(self.tolerances, Tolerances):
            raise SettingsError(f"tolerances must be Tolerances, got {self.tolerances!r}")
        if self.backend not in BACKENDS:
            raise SettingsError(f"backend must be one of {BACKENDS}, got {self.backend!r}")

    def named(self) -> dict[str, Any]:
        """Return the settings by name, as `best.json` stores them."""
        return asdict(self)

    def _check_horizons(self) -> None:
        for name in ("N_p", "N_u"):
            value = getattr(self, name)
            if not (is_number(value) and 1 <= value < np.inf and value == int(value)):
                raise SettingsError(f"{name} must be an integer of 1 or more, got {value}")
            object.__setattr__(self, name, int(value))
        if self.N_u > self.N_p:
            raise SettingsError(f"N_u must not be above N_p = {self.N_p}, got {self.N_u}")


def control_horizon(share: float, N_p: int) -> int:
    """Return N_u = max(1, `share` of N_p, rounded half up); the paper does not say how to round."""
    return max(1, int(np.floor(share * N_p + 0.5)))
