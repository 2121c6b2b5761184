"""Combine two MPCs in one controller: lane keeping, and overtaking while an obstacle is near."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from prefcal_env.envs.overtake.rules import (
    KEEPING_SPEED,
    MIN_LATERAL_DISTANCE,
    OVERTAKING_SPEED,
    Phase,
    beside,
    next_phase,
)
from prefcal_env.errors import PlantError
from prefcal_env.experiments.control import Measurement, Move
from prefcal_env.mpc import LinearMPC, MPCSettings
from prefcal_env.plants.bicycle import Bicycle

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

    def __init__(self, settings: Mapping[Phase, MPCSettings]) -> None:
        self._mpc = {phase: LinearMPC(Bicycle(), settings[phase]) for phase in Phase}
        self._ahead = {
            Phase.LANE_KEEPING: _ahead(settings[Phase.LANE_KEEPING], KEEPING_SPEED, 0.0),
            Phase.OVERTAKING: _ahead(settings[Phase.OVERTAKING], OVERTAKING_SPEED, MIN_LATERAL_DISTANCE),
        }
        self._phase, self._y_o = Phase.LANE_KEEPING, 0.0

    @property
    def T_s(self) -> float:
        """Return the sampling time [s]."""
        return self._mpc[Phase.LANE_KEEPING].T_s

    @property
    def phase(self) -> Phase:
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
        if phase is Phase.OVERTAKING:
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
