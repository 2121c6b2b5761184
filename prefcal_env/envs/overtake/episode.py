"""One drive of 15 s, one sampling period after another."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_env.envs.overtake.road.contact import Times
from prefcal_env.envs.overtake.road.geometry import Poses
from prefcal_env.envs.overtake.road.options import OvertakeOptions
from prefcal_env.envs.overtake.road.rules import KEEPING_SPEED, Phase, gap, next_phase
from prefcal_env.envs.overtake.road.traffic import Mover, Obstacle
from prefcal_env.experiments.control import Measurement
from prefcal_env.experiments.experiment import Channels, End
from prefcal_env.experiments.trajectory import Record, Trajectory

from .drive import Mishap, drive, instants
from .signals import signals_of


@dataclass(frozen=True, slots=True)
class Driven:
    """A completed period: its instants (including the start), the poses, and the held input.

    Args:
        t: Instants [s], shape (M,).
        poses: Poses at `t`, shape (M, 3).
        u: Held input (v [m/s], δ_s [rad]), shape (2,).
        phase: Phase at the start of the period.
    """

    t: Times
    poses: Poses
    u: Float[np.ndarray, " 2"]
    phase: Phase


class Episode:
    """The state of a drive and its record.

    Args:
        options: Options of the scene.
        pose: Initial pose (x_f, y_f [m], θ [rad]), shape (3,).
        T_s: Sampling time [s].
        rng: Random generator of the drivers.
    """

    def __init__(
        self,
        options: OvertakeOptions,
        pose: Float[np.ndarray, " 3"],
        T_s: float,
        rng: np.random.Generator,
    ) -> None:
        self.options, self.T_s = options, T_s
        self.t = 0.0
        self.end: End | None = None
        self.mishap: Mishap | None = None
        self.x = pose
        self.u = np.array([KEEPING_SPEED, 0.0])
        self._trajectory = Trajectory(self.x, self.u)
        self._phases: list[tuple[Phase, int]] = []
        self._steps, self.phase = 0, Phase.LANE_KEEPING
        self._times = instants(T_s, int(options.duration / T_s) + 2)
        # The obstacle's poses, all at once: faster than one by one.
        self._ahead = Obstacle().poses(self._times.ravel()).reshape(*self._times.shape, 3)
        self.simulation: Any = None
        self.movers: tuple[Mover, ...] = (Obstacle(),)
        if options.vehicles_count:
            # Imported here so that highway-env is loaded only if there is a driver.
            from .simulation import Simulation

            self.simulation = Simulation(options, self.x, rng)
            self.movers = self.simulation.movers
        self._look()

    def apply(self, u: Float[np.ndarray, " 2"]) -> Driven:
        """Drive one period with `u` held, as far as the actuators allow."""
        times = self._times[self._steps]
        if self.simulation is not None:
            self.simulation.drive(self.x, u, self.t, float(times[-1]))
        others = np.stack([self._ahead[self._steps], *(o.poses(times) for o in self.movers[1:])])
        t, x, self.mishap = drive(self.x, u, times, self.movers, others, self.options.road)
        self._trajectory.add(t[1:], x[1:], u, self.y_ref())
        self._phases.append((self.phase, len(t) - 1))
        driven = Driven(t, x, u, self.phase)
        self._steps += 1
        self.t, self.x, self.u = float(t[-1]), x[-1], u
        self._look()
        if self.mishap is not None:
            self.end = End.UNSAFE
        elif self.t >= self.options.duration * (1 - 1e-12):
            self.end = End.TIME_UP
        return driven

    def y_ref(self) -> Float[np.ndarray, " 3"]:
        """Return the reference of lane keeping: straight ahead from here, shape (3,)."""
        return np.array([self.x[0], 0.0, 0.0])

    def measurement(self) -> Measurement:
        """Return what a controller knows at this sampling instant."""
        seen = self.x.copy()
        return Measurement(self.t, seen, self.u, self.obstacles.flatten(), self.y_ref(), y=seen)

    def nearest(self) -> tuple[float, float]:
        """Return gap and y_f - y_o to the vehicle nearest along the road [m]."""
        x, y = self.x[:2].tolist()
        x_o, y_o, _ = min(self.obstacles.tolist(), key=lambda row: abs(row[0] - x))
        return gap(x, x_o), y - y_o

    def record(self, channels: Channels) -> Record:
        """Return the drive so far, with its signals."""
        record = self._trajectory.record(channels, self.end)
        last = self._phases[-1][0] if self._phases else self.phase
        held = np.array([*self._phases, (last, 1)], dtype=int)
        phases = np.repeat(held[:, 0].astype(float), held[:, 1])
        signals = signals_of(record.t, record.x, phases, self.movers, self.options.road)
        return replace(record, signals=signals)

    def _look(self) -> None:
        """Update where every vehicle is at this sampling instant."""
        self.obstacles = np.array([o.row(self.t) for o in self.movers])
        self.phase = next_phase(self.phase, float(self.x[0]), self.obstacles)
