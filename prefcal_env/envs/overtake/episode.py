"""One drive of 15 s, one sampling period after another."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_env.envs.overtake.road.contact import Times
from prefcal_env.envs.overtake.road.geometry import Poses
from prefcal_env.envs.overtake.road.options import OvertakeOptions
from prefcal_env.envs.overtake.road.rules import KEEPING_SPEED, Phase, gap, next_phase
from prefcal_env.envs.overtake.road.traffic import Driver, Mover, Obstacle, rows
from prefcal_env.experiments.control import Measurement
from prefcal_env.experiments.experiment import Channels, End
from prefcal_env.experiments.trajectory import Record, Trajectory

from .drive import Mishap, Scene, instants
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
        rng: Random generator of the measurement noise and of random traffic.
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
        self.x = np.concatenate([pose, options.car.others])
        self.u = np.array([KEEPING_SPEED, 0.0])
        self._rng, self._noise = rng, np.array(options.noise) if any(options.noise) else None
        self._trajectory = Trajectory(self.x, self.u)
        self._phases: list[tuple[Phase, int]] = []
        self._steps, self.phase = 0, Phase.LANE_KEEPING
        self._times = instants(T_s, int(options.duration / T_s) + 2)
        self.vehicles = options.vehicles(rng, float(pose[0]))
        self.simulation: Any = None
        if any(isinstance(vehicle, Driver) for vehicle in self.vehicles):
            # Imported here so that highway-env is loaded only if there is a driver.
            from .simulation import Simulation

            self.simulation = Simulation(options, self.vehicles, self.x, rng)
            self.movers: tuple[Mover, ...] = self.simulation.movers
        else:
            self.movers = tuple(v for v in self.vehicles if isinstance(v, Obstacle))
            # All at once: faster than one by one.
            self._rows = rows(self.movers, self._times[:, 0])
            poses = [o.poses(self._times.ravel()) for o in self.movers]
            self._others = np.stack([p.reshape(*self._times.shape, 3) for p in poses], axis=1)
        self._scene = Scene(options.car.plant, self.movers, options.road)
        self._look()

    def apply(self, u: Float[np.ndarray, " 2"]) -> Driven:
        """Drive one period with `u` held, as far as the actuators allow."""
        times = self._times[self._steps]
        if self.simulation is None:
            others = self._others[self._steps]
        else:
            self.simulation.drive(self.x, u, self.t, float(times[-1]))
            others = np.stack([o.poses(times) for o in self.movers])
        t, x, self.mishap = self._scene.drive(self.x, u, times, others)
        self._trajectory.add(t[1:], x[1:], u, self.y_ref())
        self._phases.append((self.phase, len(t) - 1))
        driven = Driven(t, x[:, :3], u, self.phase)
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
        return np.array([self.measured[0], 0.0, 0.0])

    def measurement(self) -> Measurement:
        """Return what a controller knows at this sampling instant."""
        d, seen = self.obstacles.flatten(), self.measured
        return Measurement(self.t, seen, self.u, d, self.y_ref(), y=seen)

    def nearest(self, pose: Float[np.ndarray, " n"]) -> tuple[float, float]:
        """Return gap and y_f - y_o to the vehicle nearest along the road from a pose [m]."""
        x, y = float(pose[0]), float(pose[1])
        x_o, y_o, _ = min(self.obstacles.tolist(), key=lambda row: abs(row[0] - x))
        return gap(x, x_o), y - y_o

    def record(self, channels: Channels) -> Record:
        """Return the drive so far, with its signals."""
        record = self._trajectory.record(channels, self.end)
        last = self._phases[-1][0] if self._phases else self.phase
        held = np.array([*self._phases, (last, 1)], dtype=int)
        phases = np.repeat(held[:, 0].astype(float), held[:, 1])
        poses, road = record.x[:, :3], self.options.road
        signals = signals_of(record.t, poses, phases, self.movers, road)
        return replace(record, signals=signals)

    def _look(self) -> None:
        """Update where every vehicle is at this sampling instant."""
        if self.mishap is None and self.simulation is None:
            self.obstacles = self._rows[self._steps]
        else:
            self.obstacles = rows(self.movers, np.array([self.t]))[0]
        self.phase = next_phase(self.phase, float(self.x[0]), self.obstacles)
        noise = 0.0 if self._noise is None else self._noise * self._rng.standard_normal(3)
        self.measured = self.x[:3] + noise
