"""A closed loop to tune: plant, controller and task as data, and how one experiment runs."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from prefcal_env.experiments.end import End
from prefcal_env.experiments.experiment import Channel, Channels, Experiment
from prefcal_env.knobs.space import KnobSpace
from prefcal_scenarios.scenario import KPI, Panel, Scenario

from .controllers import Tunable
from .course import Course, Trace
from .kpis import compute_kpis, kpis_of, time_outside
from .plants import Plant
from .wording import about_knob, brief_of

Vary = Callable[[float], float]
"""Function that returns the value to use in place of a positive nominal one."""
_FACTOR = 1.5
"""Random parameters lie between the nominal value divided and multiplied by this."""


def nominal(value: float) -> float:
    """Return `value` itself: so the named loops are made."""
    return value


def random(rng: np.random.Generator) -> Vary:
    """Return a function that draws values around the nominal one, uniform in the logarithm."""

    def vary(value: float) -> float:
        return float(value * _FACTOR ** rng.uniform(-1.0, 1.0))

    return vary


@dataclass(frozen=True, slots=True)
class Timing:
    """Times of a loop, all in `unit`."""

    step: float  # step of the simulation
    horizon: float  # length of an experiment
    # Sampling time of the controller; a knob called T_s replaces it. It is rounded to a
    # multiple of `step`
    T_s: float
    disturbed_at: float  # time at which the disturbance sets in
    dead_time: float = 0.0  # dead time of the inputs
    unit: str = "s"  # unit of time


@dataclass(frozen=True, slots=True)
class Task:
    """What happens in an experiment. It starts in a steady state."""

    x0: tuple[float, ...]  # state at the start
    u0: tuple[float, ...]  # inputs at the start
    target: tuple[float, ...]  # reference of each measured state from the start on
    # Disturbance before and after it sets in, for each of its components
    disturbance: tuple[tuple[float, float], ...]
    noise: tuple[float, ...]  # standard deviation of the noise of each measured state
    # Later set points of the first measured state, each with the time from which on it holds
    program: tuple[tuple[float, float], ...] = ()

    def reference(self, t: Float[np.ndarray, " K"]) -> Float[np.ndarray, "K n_m"]:
        """Return the references of the measured states at the times `t`."""
        found = np.tile(np.array(self.target, dtype=float), (len(t), 1))
        for start, value in self.program:
            found[t >= start, 0] = value
        return found


@dataclass(frozen=True, slots=True)
class Actuator:
    """What lies between the controller's output and the plant, all in the input's unit."""

    stiction: float = 0.0  # largest change of the command that does not move it
    backlash: float = 0.0  # half of its play
    resolution: float = 0.0  # distance of the positions that it can have; 0 if it can have any


@dataclass(frozen=True)
class Loop:
    """A closed loop whose controller is tuned.

    The limits of safe operation are the `low` and `high` of the states' channels: a run ends as
    unsafe at the first instant at which a state is outside them, and as failed if there is no
    controller for θ. The `low` and `high` of the inputs' channels end nothing: there the inputs
    saturate.
    """

    name: str  # short name
    title: str  # title for headings
    brief: str  # what happens in an experiment, for the person who compares
    plant: Plant  # plant with its parameters
    controller: Tunable  # kind of controller
    space: KnobSpace  # knobs, named as in the controller
    states: tuple[Channel, ...]  # channels of the states, with the limits of safe operation
    inputs: tuple[Channel, ...]  # channels of the inputs, with the limits at which they saturate
    task: Task  # what happens in an experiment
    timing: Timing  # times
    # Indices of the measured states; the first one's reference steps
    measured: tuple[int, ...] = (0,)
    controlled: int = 1  # number of measured states, from the first, with a reference for people
    # Index of a state that the step should not move much; None if there is none
    beside: int | None = None
    staged: bool = False  # whether the input has stages
    sample: int = 128  # number of random θ that show whether the loop is worth tuning
    # Actuators of the inputs; () if all are ideal. Not for an MPC
    actuators: tuple[Actuator, ...] = ()
    # Distance of the values that each measured state can have, 0 for continuous ones; () if
    # all are. Not for an MPC
    resolution: tuple[float, ...] = ()
    # Lowest and highest value of the first measured state that is no cause for alarm; None if
    # there is no alarm
    alarm: tuple[float, float] | None = None

    @property
    def channels(self) -> Channels:
        """Channels of an experiment."""
        outputs = zip(self.measured[: self.controlled], self.task.target, strict=False)
        y = tuple(Channel(self.states[i].name, self.states[i].unit, target=target) for i, target in outputs)
        return Channels(self.states, self.inputs, y, self.timing.unit)

    @property
    def kpis(self) -> tuple[KPI, ...]:
        """KPIs of an experiment."""
        beside = None if self.beside is None else self.states[self.beside]
        first, unit = self.channels.y[0], self.timing.unit
        return kpis_of(first, self.inputs[0], unit, beside, staged=self.staged, alarm=self.alarm)

    def run(
        self, theta: Float[np.ndarray, " n"], seed: int = 0, space: KnobSpace | None = None
    ) -> Experiment:
        """Run one experiment of θ, physical, shape (n,); deterministic for θ and `seed`.

        The seed draws the measurement noise, which does not depend on θ.

        Raises:
            KnobError: If θ has the wrong shape, is NaN, or is outside `space`.
        """
        theta = (space or self.space).check(theta)
        values = dict(zip(self.space.names, theta.tolist(), strict=True))
        # A knob called "every" is the number of sampling periods between two decisions.
        T_s = values.get("T_s", self.timing.T_s) * values.get("every", 1.0)
        hold = max(round(T_s / self.timing.step), 1)
        try:
            driven = self.controller.drive(values, self.course(hold, seed))
        except np.linalg.LinAlgError:
            driven = Trace.nothing(len(self.states), len(self.inputs))
        return self._experiment(theta, driven, hold)

    def scenario(self) -> Scenario:
        """Return the loop as a scenario."""
        return Scenario(
            name=self.name,
            title=self.title,
            space=self.space.described({name: about_knob(name) for name in self.space.names}),
            run=self.run,
            kpis=self.kpis,
            panels=(*self._state_panels(), *(Panel(c.name) for c in self.inputs)),
            brief=brief_of(self.brief, self.states),
            simulated=True,
        )

    def _state_panels(self) -> tuple[Panel, ...]:
        """Return the panels of the controlled states and of the one beside.

        A limit is drawn only if it is at most twice as far from the target as the start is: the
        others would leave the response hardly any room.
        """
        first, target = self.measured[0], self.task.target[0]
        room = 2 * abs(target - self.task.x0[first])

        def near(i: int, limit: float, otherwise: float) -> float:
            return limit if i == first and abs(limit - target) <= room else otherwise

        beside = () if self.beside is None else (self.beside,)
        return tuple(
            Panel(c.name, low=near(i, c.low, -np.inf), high=near(i, c.high, np.inf))
            for i, c in enumerate(self.states)
            if i in (*self.measured[: self.controlled], *beside)
        )

    def course(self, hold: int, seed: int) -> Course:
        """Return what acts on the loop if the controller acts every `hold` steps.

        The seed draws the noise of every instant.
        """
        timing, task = self.timing, self.task
        noise = np.random.default_rng(seed).standard_normal((self._instants, len(task.noise)))
        t = np.arange(self._instants) * timing.step
        before, after = np.array(task.disturbance, dtype=float).T
        limits = np.array([(c.low, c.high) for c in self.inputs], dtype=float)
        rows = [
            (a.stiction, a.backlash, a.resolution, low)
            for a, (low, _) in zip(self.actuators, limits, strict=False)
        ]
        return Course(
            plant=self.plant,
            x0=np.array(task.x0, dtype=float),
            u0=np.array(task.u0, dtype=float),
            limits=limits,
            safe=np.array([(c.low, c.high) for c in self.states], dtype=float),
            measured=np.array(self.measured, dtype=np.int64),
            reference=task.reference(t),
            disturbance=np.where((t >= timing.disturbed_at)[:, None], after, before),
            noise=noise * np.array(task.noise, dtype=float),
            step=timing.step,
            hold=hold,
            delay=round(timing.dead_time / timing.step),
            actuators=np.array(rows, dtype=float).reshape(-1, 4),
            resolution=np.array(self.resolution, dtype=float),
        )

    @property
    def _instants(self) -> int:
        """Number of instants of a whole experiment."""
        return round(self.timing.horizon / self.timing.step) + 1

    def _experiment(self, theta: Float[np.ndarray, " n"], driven: Trace, hold: int) -> Experiment:
        """Return the record with its KPIs; it is empty if there was no controller."""
        timing, steps = self.timing, hold * np.arange(len(driven.solved))
        bare = Experiment(
            theta=theta,
            t=np.arange(len(driven.x)) * timing.step,
            x=driven.x,
            u=driven.u,
            t_control=steps * timing.step,
            u_control=driven.u[steps],
            y_ref=self.task.reference(steps * timing.step)[:, : self.controlled],
            iterations=driven.iterations,
            solve_time=driven.solve_time,
            solved=driven.solved,
            channels=self.channels,
            end=self.end(driven.x),
        )
        if len(steps) == 0:
            return bare
        pace = timing.T_s / (hold * timing.step)
        values = compute_kpis(bare, timing.disturbed_at, self.task.u0[0], self.beside, pace)
        if self.alarm is not None:
            values["alarm"] = time_outside(bare, *self.alarm)
        return replace(bare, kpis={kpi.name: values[kpi.name] for kpi in self.kpis})

    def end(self, x: Float[np.ndarray, "V n_x"]) -> End:
        """Return why an experiment with these states ended."""
        if not len(x):
            return End.FAILED
        safe = all(c.low <= v <= c.high for c, v in zip(self.states, x[-1], strict=True))
        return End.TIME_UP if safe and len(x) == self._instants else End.UNSAFE
