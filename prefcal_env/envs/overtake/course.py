"""The overtaking as a closed loop, which `OvertakeEnv` shows on highway-env's road."""

from dataclasses import replace
from enum import Enum
from typing import Any

import numpy as np
from gymnasium.utils import seeding
from jaxtyping import Float

from prefcal_env.arrays import known_options, number_in, plant_vector
from prefcal_env.envs.task import Period
from prefcal_env.errors import PlantError, ProtocolError
from prefcal_env.experiments.experiment import Channels, End, Measurement, Record, Trajectory
from prefcal_env.plants.bicycle import Bicycle

from .scene import (
    HIGH,
    KEEPING_SPEED,
    LOW,
    T_S_RANGE,
    DrivePhase,
    Mover,
    Obstacle,
    OvertakeOptions,
    Poses,
    Times,
    first_contact,
    gap,
    kept,
    next_phase,
    outside,
    separation,
    signals_of,
    surely_apart,
)

SUB_STEP = 0.02  # longest step between recorded instants [s]
ROAD_MARGIN = 1.0  # distance off the road at which a body has left it [m]
_PLANT, _NONE = Bicycle(), np.zeros(0)


class Mishap(Enum):
    """Reason why an episode ended early."""

    COLLISION = "collision"
    OFF_ROAD = "off the road"


class Course:
    """A `ClosedLoopEnv` that drives episodes of the overtaking; `rollout` accepts it as it is.

    `OvertakeEnv` adds the spaces, rewards and pictures of an environment. This class does not load
    highway-env unless there are drivers.

    `t` [s], `x`, `u`, `phase`, `obstacles` (rows of (x_o, y_o [m], v_o [m/s])), `end` and `mishap`
    are those of the current or last episode.

    Args:
        options: Differences from the paper; None for none.
    """

    plant: Bicycle = _PLANT
    channels = Channels(_PLANT.states, _PLANT.inputs, _PLANT.outputs)

    def __init__(self, options: OvertakeOptions | None = None) -> None:
        self.options = options or OvertakeOptions()
        self.plant = Bicycle(self.options.wheelbase)
        self.end: End | None = None
        self.mishap: Mishap | None = None
        self.phase = DrivePhase.LANE_KEEPING
        self._rng: np.random.Generator | None = None
        self._trajectory: Trajectory | None = None

    def reset(
        self,
        *,
        seed: int | None = None,
        options: dict[str, Any] | None = None,
        rng: np.random.Generator | None = None,
    ) -> None:
        """Start an episode.

        Args:
            seed: Seed of the drivers; None continues the random numbers of the previous one.
            options: Sampling time `T_s` [s], and pose `x0`; None uses that of the scene.
            rng: Random generator of the drivers, in place of the seed.

        Raises:
            SettingsError: If the sampling time is out of range, or an option is unknown.
            PlantError: If the pose has the wrong shape, is not finite, off the road, or in a
                collision.
        """
        given = known_options(options, ("T_s", "x0"))
        if rng is not None:
            self._rng = rng
        elif seed is not None or self._rng is None:
            # Gymnasium's own way, so that a seed means the same drivers here and in `OvertakeEnv`.
            self._rng, _ = seeding.np_random(seed)
        T_s = number_in(given.get("T_s", 0.1), T_S_RANGE, "T_s")
        x0 = given.get("x0")
        pose = plant_vector(self.options.x0 if x0 is None else x0, 3, "initial pose x0")
        simulation = None
        if self.options.vehicles_count:
            # Imported here so that highway-env is loaded only if there are drivers.
            from .vehicles import Drivers

            simulation = Drivers(self.options, pose, self._rng)
        movers: tuple[Mover, ...] = (Obstacle(), *(simulation.tracks if simulation else ()))
        # Such a start ends every run in the first instant, whatever θ is: that is the caller's mistake.
        touching = any(separation(pose[None], o.at(np.zeros(1))[:, :3])[0] <= 0 for o in movers)
        if touching or outside(pose[None], self.options.road)[0] > ROAD_MARGIN:
            raise PlantError(f"the initial pose x0 is in a collision or off the road: {pose}")
        self.simulation, self.movers = simulation, movers
        self.t, self.x, self.u = 0.0, pose, np.array([KEEPING_SPEED, 0.0])
        self.end, self.mishap = None, None
        self._trajectory = Trajectory(self.x, self.u)
        self._phases: list[tuple[DrivePhase, int]] = []
        # Two more: for the rest of a duration that is no multiple of T_s, and for rounding.
        self._times = _instants(T_s, int(self.options.duration / T_s) + 2)
        # Where the obstacle will be, all at once: faster than period by period.
        self._ahead = Obstacle().at(self._times.ravel()).reshape(*self._times.shape, 4)
        self.phase = DrivePhase.LANE_KEEPING
        self._look(np.concatenate([mover.at(np.zeros(1)) for mover in movers]))

    def apply(self, u: Float[np.ndarray, " 2"]) -> Period:
        """Hold v [m/s] and δ_s [rad], shape (2,), for one sampling period; they saturate.

        Raises:
            PlantError: If the inputs have the wrong shape or are NaN.
            ProtocolError: If no episode is running.
        """
        trajectory = self._begun()
        if self.end is not None:
            raise ProtocolError("the episode is over: call reset() first")
        u = np.minimum(np.maximum(plant_vector(u, 2, "input u", finite=False), LOW), HIGH)
        step = len(self._phases)
        times = self._times[step]
        if self.simulation is not None:
            # Drivers drive the whole period first: then their paths are as known as the obstacle's.
            self.simulation.drive(self.x, u, self.t, float(times[-1]))
        others = np.stack([self._ahead[step], *(o.at(times) for o in self.movers[1:])])
        t, x, self.mishap = self._period(u, times, others)
        period = Period(t, x, u_before=self.u, u=u, y_ref=self._y_ref(), T_s=float(times[-1] - times[0]))
        trajectory.add(t[1:], x[1:], u, period.y_ref)
        self._phases.append((self.phase, len(t) - 1))
        self.t, self.x, self.u = float(t[-1]), x[-1], u
        if self.mishap is not None:
            self.end = End.UNSAFE
            self._look(np.concatenate([mover.at(t[-1:]) for mover in self.movers]))
            return period
        self._look(others[:, -1])
        if self.t >= self.options.duration * (1 - 1e-12):
            self.end = End.TIME_UP
        return period

    def _period(
        self, u: Float[np.ndarray, " 2"], t: Times, others: Float[np.ndarray, "n M1 4"]
    ) -> tuple[Float[np.ndarray, " D"], Float[np.ndarray, "D 3"], Mishap | None]:
        """Drive with `u` held from the first of `t` to the last or to a mishap, which is returned, too.

        `others` are the places of the other vehicles at `t`. The returned instants end with the period.
        """
        start, x = t[0], self.x

        def states(at: Times) -> Poses:
            later = at[at > start]
            after = self.plant.hold(x, u, _NONE, later - start)
            return after if len(later) == len(at) else np.concatenate([x[None], after])

        def motion(at: Times) -> tuple[Poses, list[Poses]]:
            return states(at), [mover.at(at)[:, :3] for mover in self.movers]

        driven = np.concatenate([x[None], self.plant.hold(x, u, _NONE, t[1:] - start)])
        last, left = kept(driven, self.options.road, ROAD_MARGIN)
        # Off the road first: a contact after that never happens.
        t, driven, touched = t[: last + 1], driven[: last + 1], None
        # The exact search is needed in few periods: far apart, the boxes around both bodies do not meet.
        if not surely_apart(driven, others):
            touched = first_contact(motion, t)
        if touched is None:
            return t, driven, Mishap.OFF_ROAD if left else None
        n = int(np.searchsorted(t[1:], touched)) + 1
        driven = np.concatenate([driven[:n], states(np.array([touched]))])
        return np.append(t[:n], touched), driven, Mishap.COLLISION

    def measurement(self) -> Measurement:
        """Return what a controller knows: x is the pose, d is (x_o, y_o, v_o) of each.

        d has one row for each other vehicle. `y_ref` is (x_f, 0, 0), for lane keeping; references
        that depend on the phase are up to the controller. Raises ProtocolError before the first
        episode.
        """
        self._begun()
        # A controller may write into what it is given.
        seen = self.x.copy()
        return Measurement(self.t, seen, self.u, self.obstacles.flatten(), self._y_ref(), y=seen)

    def nearest(self) -> tuple[float, float]:
        """Return gap and y_f - y_o to the vehicle nearest along the road [m]."""
        x, y = self.x[:2].tolist()
        x_o, y_o, _ = min(self.obstacles.tolist(), key=lambda row: abs(row[0] - x))
        return gap(x, x_o), y - y_o

    def record(self) -> Record:
        """Return the current or last episode. Raises ProtocolError if there is none.

        The record has n sub-steps of T_s/n in each period, of at most 0.02 s, and the end; a
        collision is recorded at its exact time. Its signals are those of `signals_of`.
        """
        record = self._begun().record(self.channels, self.end)
        last = self._phases[-1][0] if self._phases else self.phase
        # One more row for the last instant, which ends the last period and begins none.
        held = np.array([*self._phases, (last, 1)], dtype=int)
        phases = np.repeat(held[:, 0].astype(float), held[:, 1])
        signals = signals_of(record.t, record.x, phases, self.movers, self.options.road)
        return replace(record, signals=signals)

    def _begun(self) -> Trajectory:
        if self._trajectory is None:
            raise ProtocolError("no episode yet: call reset() first")
        return self._trajectory

    def _y_ref(self) -> Float[np.ndarray, " 3"]:
        """Return the reference of lane keeping: straight ahead from here, shape (3,)."""
        return np.array([self.x[0], 0.0, 0.0])

    def _look(self, places: Float[np.ndarray, "n 4"]) -> None:
        """Note where every vehicle is at this sampling instant."""
        self.obstacles = places[:, [0, 1, 3]]
        # Phases change at sampling instants only, where a controller can know of them.
        self.phase = next_phase(self.phase, float(self.x[0]), self.obstacles)


def _instants(T_s: float, periods: int) -> Float[np.ndarray, "periods M1"]:
    """Return the recorded instants of each period: its start, and the ends of M equal sub-steps.

    None is a sum of others, so time is exact.
    """
    # Rounding must not add a step where T_s is a multiple of the longest one.
    n = max(1, int(np.ceil(T_s / SUB_STEP - 1e-9)))
    return np.asarray((np.arange(periods)[:, None] + np.arange(n + 1) / n) * T_s)
