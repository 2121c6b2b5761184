"""Define the knobs of the CSTR's MPC, and build the controller of a θ (section IV-A)."""

from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_env.envs.cstr import MAX_MOVE
from prefcal_env.experiments.control import Controller
from prefcal_env.knobs.knob import Knob
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.mpc import EstimatingMPC, EstimatorSettings, LinearMPC, MPCSettings, control_horizon
from prefcal_env.plants import CSTR

SPACE = KnobSpace(
    [Knob("T_s", 0.25, 1.5, "h"), Knob("N_p", 4, 40, integer=True), Knob("log Q_Δu", -5.0, 3.0)]
)
"""The logarithm itself is the knob.

Deviation: base 10; the paper states no base. With base 10 the lowest index lies where the paper's
GLIS found it, with base e it does not (docs/deviations.md).
"""


def mpc_settings(theta: Float[np.ndarray, " 3"], space: KnobSpace = SPACE) -> MPCSettings:
    """Return the MPC settings at θ = (T_s [h], N_p, log10 Q_Δu); the paper fixes all others.

    Only C_A is tracked (Q_y = diag(0, 1)), N_u = N_p/3 rounded half up, T_c in [284, 310] K with
    moves of at most 10 K; no limits on outputs.

    Raises:
        KnobError: If θ has the wrong shape, is NaN, or is outside the box.
    """
    T_s, N_p, log_Q_du = (float(v) for v in space.check(theta))
    limits = CSTR.inputs[0]
    return MPCSettings(
        T_s=T_s,
        N_p=int(N_p),
        N_u=control_horizon(1 / 3, int(N_p)),
        Q_y=[[0.0, 0.0], [0.0, 1.0]],
        Q_u=[[0.0]],
        Q_du=[[10.0**log_Q_du]],
        u_min=[limits.low],
        u_max=[limits.high],
        du_min=[-MAX_MOVE],
        du_max=[MAX_MOVE],
    )


ESTIMATOR = EstimatorSettings(noise=(0.3, 0.03), process=(0.1, 0.01), drift=(0.1, 0.01), on_outputs=(0, 1))
"""Beyond the paper: for T and C_A measured with 0.3 K and 0.03 kgmol/m³ of noise, offset-free."""


def controller(
    theta: Float[np.ndarray, " 3"], estimator: EstimatorSettings | None = None, space: KnobSpace = SPACE
) -> Controller:
    """Create an MPC tuned by θ = (T_s [h], N_p, log10 Q_Δu), shape (3,), physical.

    The paper uses no estimator; `ESTIMATOR` is one.
    """
    tuned = mpc_settings(theta, space)
    return LinearMPC(CSTR(), tuned) if estimator is None else EstimatingMPC(CSTR(), tuned, estimator)


def settings(theta: Float[np.ndarray, " 3"], space: KnobSpace = SPACE) -> dict[str, Any]:
    """Return the MPC settings at θ as plain data."""
    return mpc_settings(theta, space).named()
