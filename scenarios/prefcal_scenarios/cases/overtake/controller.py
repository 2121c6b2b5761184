"""The controller of section IV-B: two MPCs, their supervisor, and their knobs."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from math import inf, pi
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_env.envs.overtake.scene import (
    KEEPING_SPEED,
    KEEPING_SPEEDS,
    MIN_LATERAL_DISTANCE,
    OVERTAKING_SPEED,
    OVERTAKING_SPEEDS,
    T_S_RANGE,
    DrivePhase,
    beside,
    next_phase,
)
from prefcal_env.errors import PlantError
from prefcal_env.experiments.experiment import Measurement, Move
from prefcal_env.knobs import Knob, KnobSpace
from prefcal_env.mpc import LinearMPC, MPCSettings, control_horizon
from prefcal_env.plants.bicycle import Bicycle

# --- Combine two MPCs in one controller: lane keeping, and overtaking while an obstacle is near.

_NONE = np.zeros(0)


class Supervisor:
    """A `Controller` of the bicycle that keeps its lane and overtakes (section IV-B).

    It chooses the phase itself (`next_phase`), from (x_o, y_o [m], v_o [m/s]) of each obstacle in
    `Measurement.d`; `Measurement.y_ref` is not used.

    - Lane keeping: y_ref = 0, 50 km/h.
    - Overtaking: y_ref = y_o + 3 m, 60 km/h, y_f >= y_o + 3 m (soft); y_o of the leftmost obstacle
      that is `beside`.
    - The reference of x_f runs ahead of the current position at the reference speed, previewed:
      x_f + v_ref T_s k. The speed is tracked; the controller does not catch up lost ground.

    The model does not depend on the position of the car, so the MPC sees positions relative to its
    front end and, while overtaking, to the obstacle's center line. So the limits need no change if
    an obstacle moves sideways.

    When the phase changes, the last v may be below the new limit; since its moves are not limited,
    the QP stays feasible.

    Args:
        settings: MPC settings of each phase, with the same sampling time; while overtaking, y_min
            of y_f is relative to the obstacle's center line.

    Raises:
        SettingsError: If the settings do not fit the plant.
    """

    def __init__(self, settings: Mapping[DrivePhase, MPCSettings]) -> None:
        self._mpc = {phase: LinearMPC(Bicycle(), settings[phase]) for phase in DrivePhase}
        aims = {
            DrivePhase.LANE_KEEPING: (KEEPING_SPEED, 0.0),
            DrivePhase.OVERTAKING: (OVERTAKING_SPEED, MIN_LATERAL_DISTANCE),
        }
        self._ahead = {phase: _ahead(settings[phase], *aim) for phase, aim in aims.items()}
        self._phase, self._y_o = DrivePhase.LANE_KEEPING, 0.0

    @property
    def T_s(self) -> float:
        """Return the sampling time [s]."""
        return self._mpc[DrivePhase.LANE_KEEPING].T_s

    @property
    def phase(self) -> DrivePhase:
        """Return the phase of the last move."""
        return self._phase

    def move(self, measurement: Measurement) -> Move:
        """Decide the next input (v [m/s], δ_s [rad]).

        Raises:
            PlantError: If `measurement.d` does not hold three numbers for each obstacle.
        """
        m = measurement
        if m.d.ndim != 1 or len(m.d) % 3:
            raise PlantError(f"d must hold x_o, y_o and v_o of each obstacle, shape (3 n,), got {m.d.shape}")
        obstacles = m.d.reshape(-1, 3)
        x_f, y_f, yaw = m.x.tolist()
        phase = next_phase(self._phase, x_f, obstacles)
        if phase is not self._phase:
            self._mpc[phase].forget()
        self._phase = phase
        line = 0.0
        if phase is DrivePhase.OVERTAKING:
            near = beside(x_f, obstacles)
            if len(near):  # otherwise keep the last one
                self._y_o = float(near[:, 1].max())
            line = self._y_o
        x = np.array([0.0, y_f - line, yaw])
        return self._mpc[phase].move(Measurement(m.t, x, m.u, _NONE, self._ahead[phase]))


def _ahead(settings: MPCSettings, speed: float, y: float) -> Float[np.ndarray, "N_p 3"]:
    """Return references of (x_f, y_f, θ) for the next N_p samples, relative to the front end."""
    k = np.arange(1, settings.N_p + 1)
    return np.column_stack([speed * settings.T_s * k, np.full(len(k), y), np.zeros(len(k))])


# --- Define the knobs of the car's MPC, and build the controller of a θ (section IV-B).

SPACE = KnobSpace(
    [
        Knob("T_s", *T_S_RANGE, "s"),
        Knob("ε_c", 0.1, 1.0, step=0.03),  # about one free move at N_p = 30
        Knob("N_p", 10, 30, integer=True),
        Knob("log q_u11", -5.0, 3.0),
        Knob("log q_u22", -5.0, 3.0),
    ]
)
"""The logarithms themselves are the knobs.

Deviation: base 10; the paper states no base (docs/deviations.md).
"""

_ANGLE = pi / 4


@dataclass(frozen=True, slots=True)
class Fixed:
    """MPC settings that are not tuned.

    Deviation: the paper states ±π/4 and 0.0873 rad/s for θ. Here ±π/4 holds for θ (soft) and for
    δ_s (hard), 0.0873 rad/s for the rate of δ_s (hard), so 0.0873 T_s per step, because a yaw rate
    is not an input.
    """

    steering_rate: float = 0.0873  # largest rate of δ_s from one step to the next [rad/s]
    steering_move: float = inf  # largest move of δ_s in one step [rad]
    # Weight of the slack. Deviation: the paper has no value. With 1e5, a toolbox's default, the one slack
    # makes the car swerve off the road at the paper's optimum.
    Q_eps: float = 10.0


PAPER = Fixed()  # settings of the case study
STEERING_LIMITS: Mapping[str, Fixed] = {
    "per second": PAPER,
    "per step": Fixed(steering_rate=inf, steering_move=0.0873),
}
"""What 0.0873 limits: the rate of δ_s, or its move per step for any sampling time."""


def mpc_settings(
    theta: Float[np.ndarray, " 5"], phase: DrivePhase, fixed: Fixed = PAPER, space: KnobSpace = SPACE
) -> MPCSettings:
    """Return MPC settings of one phase, θ = (T_s [s], ε_c, N_p, log10 q_u11, log10 q_u22).

    Outputs (x_f, y_f [m], θ [rad]), y_f relative to the obstacle's center line while overtaking;
    inputs (v [m/s], δ_s [rad]). Q_y = diag(1, 1, 0), Q_u = 0, Q_Δu = diag(q_u11, q_u22).

    Raises:
        KnobError: If θ has the wrong shape, is NaN, or is outside the box.
    """
    return _settings(tuple(space.check(theta).tolist()), DrivePhase(phase), fixed)


@lru_cache(maxsize=64)  # the KPIs of an experiment need those of its controller again
def _settings(theta: tuple[float, ...], phase: DrivePhase, fixed: Fixed) -> MPCSettings:
    T_s, share, N_p, log_q11, log_q22 = theta
    overtaking = phase is DrivePhase.OVERTAKING
    low, high = OVERTAKING_SPEEDS if overtaking else KEEPING_SPEEDS
    beside = MIN_LATERAL_DISTANCE if overtaking else -inf
    steering_move = min(fixed.steering_rate * T_s, fixed.steering_move)
    return MPCSettings(
        T_s=T_s,
        N_p=int(N_p),
        N_u=control_horizon(share, int(N_p)),
        Q_y=np.diag([1.0, 1.0, 0.0]),
        Q_u=np.zeros((2, 2)),
        Q_du=np.diag([10.0**log_q11, 10.0**log_q22]),
        u_min=[low, -_ANGLE],
        u_max=[high, _ANGLE],
        du_min=[-inf, -steering_move],
        du_max=[inf, steering_move],
        y_min=[-inf, beside, -_ANGLE],
        y_max=[inf, inf, _ANGLE],
        Q_eps=fixed.Q_eps,
        softness=(1.0, 1.0, 1.0),
        backend="piqp",  # t_comp is modeled from its iterations (`computation_time`)
    )


def controller(theta: Float[np.ndarray, " 5"], fixed: Fixed = PAPER, space: KnobSpace = SPACE) -> Supervisor:
    """Create a supervised MPC tuned by θ, shape (5,), physical. Raises like `mpc_settings`."""
    tuned = {phase: mpc_settings(theta, phase, fixed, space) for phase in DrivePhase}
    return Supervisor(tuned)


def settings(
    theta: Float[np.ndarray, " 5"], fixed: Fixed = PAPER, space: KnobSpace = SPACE
) -> dict[str, Any]:
    """Return the MPC settings as plain data, by name of the phase."""
    names = {phase: phase.name.lower().replace("_", " ") for phase in DrivePhase}
    return {name: mpc_settings(theta, phase, fixed, space).named() for phase, name in names.items()}
