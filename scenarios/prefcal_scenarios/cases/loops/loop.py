"""A closed loop to tune: plant, controller and task as data, and how one experiment runs."""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from prefcal_env.compiling import Kernel, compile_ahead
from prefcal_env.envs.step_signal import StepSignal
from prefcal_env.envs.task import Task
from prefcal_env.experiments.control import Controller, Measurement
from prefcal_env.experiments.end import End
from prefcal_env.experiments.experiment import Channel, Channels, Experiment
from prefcal_env.knobs.space import KnobSpace
from prefcal_scenarios.scenario import KPI, Panel, Scenario

from ._simulate import advance, simulate
from .controllers import Gains, Tunable, Values
from .kpis import compute_kpis, kpi_names, kpis_of, time_outside
from .plant import CompiledPlant
from .wording import about_knob, brief_of


@dataclass(frozen=True, slots=True)
class Actuator:
    """What lies between the controller's output and the plant, all in the input's unit."""

    stiction: float = 0.0  # largest change of the command that does not move it
    backlash: float = 0.0  # half of its play
    resolution: float = 0.0  # distance of the positions that it can have; 0 if it can have any


class Response(NamedTuple):
    """States and inputs of an experiment until it stopped, and the N steps of its controller."""

    x: Float[np.ndarray, "V n_x"]  # states, shape (V, n_x), finite
    u: Float[np.ndarray, "V n_u"]  # inputs, shape (V, n_u)
    iterations: Int[np.ndarray, " N"]  # solver iterations of each step, shape (N,)
    solve_time: Float[np.ndarray, " N"]  # duration of each step, s, shape (N,)
    solved: Bool[np.ndarray, " N"]  # whether each step's problem was solved, shape (N,)


@dataclass(frozen=True)
class Loop:
    """A closed loop whose controller is tuned: plant, controller and task.

    The limits of safe operation are the `low` and `high` of the states' channels: a run ends as
    unsafe at the first instant at which a state is outside them, and as failed if there is no
    controller for θ. The `low` and `high` of the inputs' channels end nothing: there the inputs
    saturate.
    """

    name: str  # short name
    title: str  # title for headings
    brief: str  # what happens in an experiment, for the person who compares
    plant: CompiledPlant  # plant with its parameters; the first output's reference steps
    controller: Tunable  # kind of controller
    space: KnobSpace  # knobs, named as in the controller
    task: Task  # what happens in an experiment; its references and disturbances are `StepSignal`s
    controlled: int = 1  # number of outputs, from the first, with a reference for people
    # Index of a state that the step should not move much; None if there is none
    beside: int | None = None
    staged: bool = False  # whether the input has stages
    # Actuators of the inputs; () if all are ideal. Not for an MPC
    actuators: tuple[Actuator, ...] = ()
    # Distance of the values that each measured state can have, 0 for continuous ones; () if
    # all are. Not for an MPC
    resolution: tuple[float, ...] = ()
    # Lowest and highest value of the first measured state that is no cause for alarm; None if
    # there is no alarm
    alarm: tuple[float, float] | None = None
    # What does not depend on θ, so that it is worked out once and not in each experiment
    channels: Channels = field(init=False, repr=False, compare=False)  # channels of an experiment
    # Instants of a whole experiment, and references and disturbances at these
    t: Float[np.ndarray, " K"] = field(init=False, repr=False, compare=False)
    _y_ref: Float[np.ndarray, "K n_y"] = field(init=False, repr=False, compare=False)
    _d: Float[np.ndarray, "K n_d"] = field(init=False, repr=False, compare=False)
    _kpi_names: tuple[str, ...] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        plant, step = self.plant, self.plant.max_step
        outputs = zip(plant.outputs[: self.controlled], self.target.start, strict=False)
        y = tuple(replace(channel, target=target) for channel, target in outputs)
        t = np.arange(round(self.task.horizon / step) + 1) * step
        names = kpi_names(staged=self.staged, beside=self.beside is not None, alarm=self.alarm is not None)
        fixed = {
            "channels": Channels(plant.states, plant.inputs, y, plant.time_unit),
            "t": t,
            "_y_ref": self.target.over(t),
            "_d": self.disturbance.over(t),
            "_kpi_names": names,
        }
        for name, value in fixed.items():
            object.__setattr__(self, name, value)

    @property
    def kpis(self) -> tuple[KPI, ...]:
        """KPIs of an experiment."""
        beside = None if self.beside is None else self.plant.states[self.beside]
        first, u, unit = self.channels.y[0], self.plant.inputs[0], self.plant.time_unit
        return kpis_of(self._kpi_names, first, u, unit, beside=beside, alarm=self.alarm)

    @property
    def target(self) -> StepSignal:
        """References of the outputs."""
        assert isinstance(self.task.y_ref, StepSignal)
        return self.task.y_ref

    @property
    def disturbance(self) -> StepSignal:
        """Disturbances, with one step."""
        assert isinstance(self.task.d, StepSignal)
        return self.task.d

    @property
    def disturbed_at(self) -> float:
        """Time at which the disturbance sets in."""
        return self.disturbance.steps[0][0]

    def noise(self, seed: int) -> Float[np.ndarray, "K n_y"]:
        """Return the noise of the measured states at every instant, shape (K, n_y)."""
        assert self.task.noise is not None
        drawn = np.random.default_rng(seed).standard_normal((len(self.t), len(self.task.noise)))
        return np.asarray(drawn * self.task.noise)

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
        T_s = values.get("T_s", self.task.T_s) * values.get("every", 1.0)
        hold = max(round(T_s / self.plant.max_step), 1)
        try:
            response = self._respond(values, hold, seed)
        except np.linalg.LinAlgError:
            response = self._nothing()
        return self._experiment(theta, response, hold)

    def scenario(self) -> Scenario:
        """Return the loop as a scenario."""
        return Scenario(
            name=self.name,
            title=self.title,
            space=self.space.described({name: about_knob(name) for name in self.space.names}),
            run=self.run,
            kpis=self.kpis,
            panels=(*self._state_panels(), *(Panel(c.name) for c in self.plant.inputs)),
            brief=brief_of(self.brief, self.plant.states),
            simulated=True,
        )

    def _respond(self, values: Values, hold: int, seed: int) -> Response:
        """Return what the controller with these values of the knobs does."""
        made = self.controller.make(values, self.plant, self.task, hold * self.plant.max_step)
        if isinstance(made, Gains):
            return self.by_law(made, hold, seed)
        return self.by_controller(made, hold, seed)

    def by_law(self, gains: Gains, hold: int, seed: int) -> Response:
        """Return what a compiled law does that acts every `hold` steps."""
        plant, task = self.plant, self.task
        x, u, valid = simulate(
            (*plant.packed, np.array(plant.measured, dtype=np.int64)),
            (*gains, self._actuator_rows(), np.array(self.resolution, dtype=float)),
            (self._y_ref, self._d, self.noise(seed)),
            (plant.max_step, hold, self._delay),
            (task.x0.copy(), task.u0.copy(), limits_of(plant.states)),
        )
        steps = len(range(0, max(valid - 1, 0), hold))  # the last instant decides none
        none, all_ = np.zeros(steps), np.ones(steps, np.bool_)
        return Response(x[:valid], u[:valid], none.astype(np.int64), none, all_)

    def by_controller(
        self, controller: Controller, hold: int, seed: int, clock: Callable[[], float] = time.perf_counter
    ) -> Response:
        """Return what `controller` does; where it does not solve its problem, the input is held.

        Actuators and sensors are ideal.

        Args:
            controller: Controller whose sampling time is `hold` steps.
            hold: Steps in a sampling period.
            seed: Seed of the noise.
            clock: Returns the time in seconds; only for the duration of the steps.
        """
        plant, t, noise = self.plant, self.t, self.noise(seed)
        (low, high), measured = limits_of(plant.inputs).T, list(plant.measured)
        reference, disturbance = self._y_ref, self._d
        x, u = np.zeros((len(t), len(plant.states))), np.zeros((len(t), len(plant.inputs)))
        history, safe = (x, u, self.task.u0.copy(), disturbance), limits_of(plant.states)
        x[0], now, valid = self.task.x0, self.task.u0, 1
        steps: list[tuple[int, float, bool]] = []
        for k in range(0, len(t) - 1, hold):
            seen = self.task.x0.copy()  # states that are not measured have their first value
            seen[measured] = x[k, measured] + noise[k]
            start = clock()
            move = controller.move(Measurement(t[k], seen, now, disturbance[0], reference[k]))
            took = clock() - start
            usable = move.solved and bool(np.isfinite(move.u).all())
            if usable:
                now = np.clip(move.u, low, high)
            steps.append((move.iterations, took, usable))
            last = min(k + hold, len(t) - 1)
            u[k : last + 1] = now
            valid, stopped = advance(plant.packed, plant.max_step, self._delay, (k, last), history, safe)
            if stopped:
                break
        each = (np.array(column) for column in zip(*steps, strict=True))
        return Response(x[:valid], u[:valid], *each)

    @property
    def _delay(self) -> int:
        """Number of steps of dead time of the inputs."""
        return round(self.plant.dead_time / self.plant.max_step)

    def _actuator_rows(self) -> Float[np.ndarray, "m 4"]:
        """Return stiction, backlash, resolution and lowest position of each input, shape (n_u, 4)."""
        pairs = zip(self.actuators, self.plant.inputs, strict=False)
        rows = [(a.stiction, a.backlash, a.resolution, c.low) for a, c in pairs]
        return np.array(rows, dtype=float).reshape(-1, 4)

    def _nothing(self) -> Response:
        """Return no states and no steps: there was no controller."""
        none, (n_x, n_u) = np.zeros(0), (len(self.plant.states), len(self.plant.inputs))
        no_states, no_inputs = np.zeros((0, n_x)), np.zeros((0, n_u))
        return Response(no_states, no_inputs, none.astype(np.int64), none, none.astype(np.bool_))

    def _state_panels(self) -> tuple[Panel, ...]:
        """Return the panels of the controlled states and of the one beside.

        A limit is drawn only if it is at most twice as far from the target as the start is: the
        others would leave the response hardly any room.
        """
        measured, target = self.plant.measured, self.target.start[0]
        first = measured[0]
        room = 2 * abs(target - self.task.x0[first])

        def near(i: int, limit: float, otherwise: float) -> float:
            return limit if i == first and abs(limit - target) <= room else otherwise

        beside = () if self.beside is None else (self.beside,)
        return tuple(
            Panel(c.name, low=near(i, c.low, -np.inf), high=near(i, c.high, np.inf))
            for i, c in enumerate(self.plant.states)
            if i in (*measured[: self.controlled], *beside)
        )

    def _experiment(self, theta: Float[np.ndarray, " n"], response: Response, hold: int) -> Experiment:
        """Return the record with its KPIs; it is empty if there was no controller."""
        plant, steps = self.plant, hold * np.arange(len(response.solved))
        bare = Experiment(
            theta=theta,
            t=self.t[: len(response.x)],
            x=response.x,
            u=response.u,
            t_control=steps * plant.max_step,
            u_control=response.u[steps],
            y_ref=self._y_ref[steps, : self.controlled],
            iterations=response.iterations,
            solve_time=response.solve_time,
            solved=response.solved,
            channels=self.channels,
            end=self.end(response.x),
        )
        if len(steps) == 0:
            return bare
        pace = self.task.T_s / (hold * plant.max_step)
        values = compute_kpis(bare, self.disturbed_at, self.task.u0[0], self.beside, pace)
        if self.alarm is not None:
            values["alarm"] = time_outside(bare, *self.alarm)
        return bare.with_kpis({name: values[name] for name in self._kpi_names})

    def end(self, x: Float[np.ndarray, "V n_x"]) -> End:
        """Return why an experiment with these states ended."""
        if not len(x):
            return End.FAILED
        safe = all(c.low <= v <= c.high for c, v in zip(self.plant.states, x[-1], strict=True))
        return End.TIME_UP if safe and len(x) == len(self.t) else End.UNSAFE


def limits_of(channels: Sequence[Channel]) -> Float[np.ndarray, "n 2"]:
    """Return the lowest and the highest value of each channel, shape (n, 2)."""
    return np.array([(c.low, c.high) for c in channels], dtype=float)


def _kernels() -> Iterator[Kernel]:
    vector, matrix = "f8[::1]", "f8[:,::1]"
    control, start = f"Tuple((i8, {matrix}, {matrix}, {vector}))", f"Tuple(({vector}, {vector}, {matrix}))"
    signals, timing = f"UniTuple({matrix}, 3)", "Tuple((f8, i8, i8))"
    types = f"(Tuple((i8, {vector}, i8[::1])), {control}, {signals}, {timing}, {start})"
    yield Kernel("closed loop", simulate, types)


compile_ahead(__name__, _kernels)
