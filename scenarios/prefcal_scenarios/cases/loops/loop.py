"""A closed loop to tune: its controllers, its KPIs, its words, and how one experiment runs."""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from math import isfinite
from typing import NamedTuple, Protocol

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.linalg import solve_discrete_are

from prefcal_env.compiling import Kernel, compile_ahead
from prefcal_env.envs.task import StepSignal, Task
from prefcal_env.envs.varied_loop import VariedLoop, moves_of
from prefcal_env.errors import SettingsError
from prefcal_env.experiments.events import entry_time
from prefcal_env.experiments.experiment import (
    Channel,
    Channels,
    Controller,
    End,
    Experiment,
    Measurement,
    Move,
)
from prefcal_env.jit import kernel
from prefcal_env.knobs import KnobSpace
from prefcal_env.plants.plant import Disturbed
from prefcal_env.plants.systems import held
from prefcal_env.sources.source import Function, Varied
from prefcal_scenarios.scenario import KPI, Panel, Scenario

from . import plants as laws
from .plants import CompiledPlant, advance, simulate

# --- Controllers that people tune: from the values of the knobs to a compiled law or a controller.

KnobValues = Mapping[str, float]


class Gains(NamedTuple):
    """A compiled law and its gains: one row for each PID or input, with columns as in `plants`."""

    law: int
    rows: Float[np.ndarray, "r c"]


class Tunable(Protocol):
    """A kind of controller."""

    def make(self, values: KnobValues, plant: CompiledPlant, task: Task, T_s: float) -> Gains | Controller:
        """Return the controller with these values of the knobs, by name, and sampling time.

        Raises:
            LinAlgError: If there is no controller for these values.
        """


_DEFAULTS: KnobValues = {"T_i": np.inf, "T_d": 0.0, "T_f": 0.0, "b": 1.0, "stages": 0, "hysteresis": 0}


@dataclass(frozen=True, slots=True)
class TunedPID:
    """One PID for each input: u = K (b r - y_f) + integral - K T_d dy_f/dt, limited; or a cascade.

    The knobs are K, T_i, T_d, T_f (filter of the measurement), b (set-point weight), T_t (of the
    anti-windup; T_i by default), stages (of the input; 0 for continuous) and hysteresis (share of
    a stage). Times are in the loop's unit.

    In a cascade of two PIDs, the outer one sets the reference of the inner one. As in most cascades
    of practice, the outer integrator stops at the range of that reference and knows nothing of the
    limits of the inner loop's input: while that is saturated, the outer one winds up as far as its
    range allows. Slow anti-windup and a fast outer loop show that, for people to judge.
    """

    # Suffix of the knobs of each PID, such as "_1" in K_1. A value without a suffix applies
    # to every PID
    suffixes: tuple[str, ...] = ("",)
    fixed: KnobValues = field(default_factory=dict)  # values that are not tuned
    # Sign of the gain of each PID; -1 if a larger input lowers the output
    signs: tuple[float, ...] = ()
    # Reference of the inner PID of a cascade at the start, and its lowest and highest value;
    # None if there is no cascade
    inner: tuple[float, float, float] | None = None

    def make(self, values: KnobValues, plant: CompiledPlant, task: Task, T_s: float) -> Gains:
        """Return the law with these values of the knobs: a row for each PID, the outer one first.

        An output starts at its value in the loop at rest, and ends at the limits.
        """
        values, signs = {**self.fixed, **values}, self.signs or (1.0,) * len(self.suffixes)
        outputs = [(u0, c.low, c.high) for u0, c in zip(task.u0, plant.inputs, strict=True)]
        if self.inner is not None:
            outputs = [self.inner, *outputs]
        each = zip(self.suffixes, signs, outputs, strict=True)
        rows = np.array([_row(values, *one) for one in each])
        return Gains(laws.PID if self.inner is None else laws.CASCADE, rows)


@dataclass(frozen=True, slots=True)
class TunedLQR:
    """Linear quadratic regulator with integral action, for one input and all states measured.

    It minimizes Σ x'Qx + q z² + R u² for the linearized plant with a zero-order hold, where z is
    the integrated error of the first state. The knobs are the weights Q_1, Q_2, ... of the states,
    Q_z of the integral, R, and T_s.
    """

    fixed: KnobValues = field(default_factory=dict)  # values that are not tuned

    def make(self, values: KnobValues, plant: CompiledPlant, task: Task, T_s: float) -> Gains:
        """Return the row K, K_z, bias, low, high; K solves the discrete Riccati equation."""
        values, c = {**self.fixed, **values}, plant.inputs[0]
        J = plant.jacobians(task.x0, task.u0, task.disturbance(0.0))
        n = len(J.A)
        A, B = np.zeros((n + 1, n + 1)), np.zeros((n + 1, 1))  # of x and z, with ż = x_1
        A[:n, :n], A[n, 0], B[:n] = J.A, 1.0, J.B
        A_d, B_d = held(A, B, T_s)
        weights = [*(values.get(f"Q_{i}", 0.0) for i in range(1, n + 1)), values["Q_z"]]
        Q, R = np.diag(weights) * T_s, np.array([[values["R"] * T_s]])
        S = solve_discrete_are(A_d, B_d, Q, R)
        K = np.linalg.solve(R + B_d.T @ S @ B_d, B_d.T @ S @ A_d)
        return Gains(laws.FEEDBACK, np.hstack([K, [[task.u0[0], c.low, c.high]]]))


def _row(values: KnobValues, suffix: str, sign: float, output: tuple[float, float, float]) -> list[float]:
    def value(name: str) -> float:
        plain = values.get(name, _DEFAULTS.get(name, np.nan))
        return float(values.get(f"{name}{suffix}", plain))

    T_i, T_t = value("T_i"), value("T_t")
    tracking = T_i if np.isnan(T_t) else T_t
    first = (sign * value("K"), T_i, value("T_d"), value("T_f"), value("b"), tracking)
    return [*first, *output, value("stages"), value("hysteresis")]


# --- Controllers on plants that are not exactly as they were designed for, and on their own.


@dataclass(frozen=True, slots=True)
class Designed:
    """A kind of controller that is designed for the plant of the study, whatever plant it meets."""

    controller: Tunable
    plant: CompiledPlant
    task: Task

    def make(self, values: KnobValues, plant: CompiledPlant, task: Task, T_s: float) -> Gains | Controller:
        """Return the controller of the study, which starts at the inputs and limits that it meets."""
        controller, found = self.controller, replace(self.plant, inputs=plant.inputs)
        if isinstance(controller, TunedPID) and controller.inner is not None:
            start = float(task.x0[plant.measured[1]]) - float(self.task.x0[plant.measured[1]])
            middle, low, high = controller.inner
            controller = replace(controller, inner=(middle + start, low, high))
        if isinstance(controller, TunedPID | TunedLQR):
            return controller.make(values, found, replace(self.task, u0=task.u0), T_s)
        return controller.make(values, self.plant, self.task, T_s)


@kernel()
def _act(law, gains, reference, y, memory, T_s, u):  # type: ignore[no-untyped-def]
    """Write the inputs that a compiled law decides to `u`."""
    laws.decide(law, gains, reference, y, memory, T_s, u)


class LawController:
    """A compiled law as a `Controller`; `T_s` is in the plant's unit of time."""

    def __init__(self, gains: Gains, T_s: float) -> None:
        self._gains, self.T_s = gains, T_s
        self._memory = np.zeros((len(gains.rows), laws.MEMORY))

    def move(self, measurement: Measurement) -> Move:
        """Decide the inputs from the measured outputs."""
        u, y = np.array(measurement.u, dtype=float), np.array(measurement.y, dtype=float)
        r = np.array(measurement.y_ref, dtype=float)
        _act(self._gains.law, np.array(self._gains.rows), r, y, self._memory, float(self.T_s), u)
        return Move(u)


# --- KPIs of a closed loop: a step of the reference, then a disturbance.

_BAND = 0.05  # band of the settling time, as a share of the step


_TEXTS = {
    "overshoot": ("overshoot of {y}", "%", "How far it goes beyond its target, as a share of the step."),
    "settling_time": (
        "settling time of {y} (within ±5 %)",
        "{time}",
        "Time after which it stays close to its target, until the disturbance.",
    ),
    "error": ("integrated error of {y}", "{unit} {time}", "Integral of the absolute error over the run."),
    "disturbance_peak": (
        "peak error of {y} after the disturbance",
        "{unit}",
        "Largest distance from the target after the disturbance.",
    ),
    "effort": (
        "effort of {u}",
        "{u_unit}",
        "Root mean square distance of the input from its value at the start.",
    ),
    "switches": ("switches of {u}", "", "How often the input changes its stage."),
    "input_noise": (
        "noise in {u}",
        "{u_unit}",
        "How much the input moves in a sampling period of normal length.",
    ),
    "side_effect": (
        "peak of {beside} after the step",
        "{beside_unit}",
        "Largest distance from its value at the start.",
    ),
    "alarm": ("{y} in alarm", "{time}", "Time outside {alarm}."),
}
"""Title, unit and meaning of each KPI by its name."""


def compute_kpis(
    experiment: Experiment, disturbed_at: float, u0: float, beside: int | None, pace: float = 1.0
) -> dict[str, float]:
    """Return the values of all KPIs, in their units; an infinite time means never.

    With several set points, the largest overshoot counts, and the sum of the settling times.

    Args:
        experiment: Experiment with a step of the first output at its start.
        disturbed_at: Time of the disturbance.
        u0: First input at the start.
        beside: Index of the state that the step should not move much.
        pace: Nominal sampling time divided by that of this experiment. Moves are counted per
            nominal one, so that many small moves are not calmer than a few large ones.
    """
    t, x, u = experiment.t, experiment.x, experiment.u_control[:, 0]
    error, steps = _errors(experiment, disturbed_at)
    first = t < disturbed_at
    moves = np.abs(np.diff(u))
    times = [entry_time(t[part] - t[part][0], error[part], _BAND * abs(step)) for part, step in steps]
    found = {
        "overshoot": max(100.0 * max(float((-error[part] / step).max()), 0.0) for part, step in steps),
        "settling_time": sum(times, start=0.0) if t[-1] >= disturbed_at else np.inf,
        "error": float(np.abs(error[:-1]) @ np.diff(t)),
        "disturbance_peak": float(np.abs(error[~first]).max()) if not first.all() else np.inf,
        "effort": float(np.sqrt(np.mean((u - u0) ** 2))),
        "input_noise": float(moves.mean()) * pace if len(moves) else 0.0,
        "switches": float(np.count_nonzero(moves)),
    }
    if beside is not None:
        found["side_effect"] = float(np.abs(x[first, beside] - x[0, beside]).max())
    return found


def _errors(
    experiment: Experiment, until: float
) -> tuple[Float[np.ndarray, " K"], list[tuple[slice, float]]]:
    """Return the error of the first output, and the steps of its reference before `until`.

    Each step is the instants up to the next one, and the error that it starts with if the output
    was at the set point before.
    """
    y, t = experiment.output(0), experiment.t
    assert y is not None
    held = np.searchsorted(experiment.t_control, t, side="right") - 1
    target = experiment.y_ref[held, 0]
    error = y - target
    starts = [0, *(np.flatnonzero(np.diff(target)) + 1).tolist()]
    starts = [start for start in starts if t[start] < until]
    ends = [*starts[1:], int(np.count_nonzero(t < until))]
    sizes = [error[0], *(target[start - 1] - target[start] for start in starts[1:])]
    parts = [slice(start, end) for start, end in zip(starts, ends, strict=True)]
    return error, [(part, float(size)) for part, size in zip(parts, sizes, strict=True)]


# --- Describe the loops and their knobs for the person who compares.

_JUDGE = (
    "Good control reaches the target soon, without overshoot or oscillation, recovers from the "
    "disturbance, and spares the actuator. What counts more is up to you."
)

_KNOBS: Mapping[str, str] = {
    "K": "Gain: a larger one reacts more strongly to errors and to noise.",
    "T_i": "Integral time: a shorter one removes lasting errors sooner, but may oscillate.",
    "T_d": "Derivative time: a longer one brakes more, and amplifies noise.",
    "T_f": "Time constant of the measurement's filter: a longer one passes less noise, but delays.",
    "b": "Share of the target's step that acts at once; a small one starts gently.",
    "T_t": "Time constant of the anti-windup: a shorter one lets go of the limit sooner.",
    "hysteresis": "How far beyond the border of a stage it switches, as a share of a stage.",
    "Q_1": "Weight of the first state's error.",
    "Q_2": "Weight of the second state's error.",
    "Q_3": "Weight of the third state's error.",
    "Q_4": "Weight of the fourth state's error.",
    "Q_z": "Weight of the integrated error: a larger one removes lasting errors sooner.",
    "N_p": "Prediction horizon: how many steps the controller looks ahead.",
    "N_u": "Control horizon: how many of these steps it may move the inputs.",
    "Q_du": "Weight of the moves: a larger one is gentler and slower.",
    "drift": "How fast the estimated disturbances may change: a larger one removes lasting errors "
    "sooner, and passes more noise.",
    "T_s": "Sampling time: how often the controller measures and acts.",
    "every": "Number of samples after which the controller acts: a larger one is calmer and later.",
    "stages": "Number of stages of the input.",
}
_WHERE: Mapping[str, str] = {
    "_outer": "Outer controller. ",
    "_inner": "Inner controller. ",
    "_1": "First controller. ",
    "_2": "Second controller. ",
}


def about_knob(name: str) -> str:
    """Return a sentence that explains the knob called `name`, such as K or T_i_outer."""
    if name in _KNOBS:
        return _KNOBS[name]
    suffix = next(suffix for suffix in _WHERE if name.endswith(suffix))
    return _WHERE[suffix] + _KNOBS[name.removesuffix(suffix)]


def brief_of(brief: str, states: Sequence[Channel]) -> str:
    """Return `brief` with what to judge by, and when an experiment stops as unsafe."""
    bounds = [
        f"{c.name} {c.low:g} to {c.high:g} {c.unit}".rstrip()
        for c in states
        if isfinite(c.low) and isfinite(c.high)
    ]
    stops = " An experiment stops as unsafe outside its limits: " + ", ".join(bounds) + "."
    return f"{brief} {_JUDGE}{stops if bounds else ''}"


# --- A closed loop to tune: plant, controller and task as data, and how one experiment runs.


@dataclass(frozen=True, slots=True)
class Actuator:
    """What lies between the controller's output and the plant, all in the input's unit."""

    stiction: float = 0.0  # largest change of the command that does not move it
    backlash: float = 0.0  # half of its play
    resolution: float = 0.0  # distance of the positions that it can have; 0 if it can have any


class LoopResponse(NamedTuple):
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
        there = {"switches": self.staged, "input_noise": not self.staged}
        there |= {"side_effect": self.beside is not None, "alarm": self.alarm is not None}
        fixed = {
            "channels": Channels(plant.states, plant.inputs, y, plant.time_unit),
            "t": t,
            "_y_ref": self.target.over(t),
            "_d": self.disturbance.over(t),
            "_kpi_names": tuple(name for name in _TEXTS if there.get(name, True)),
        }
        for name, value in fixed.items():
            object.__setattr__(self, name, value)

    @property
    def kpis(self) -> tuple[KPI, ...]:
        """KPIs of an experiment, all of them better if lower."""
        y, u, time_unit = self.channels.y[0], self.plant.inputs[0], self.plant.time_unit
        words = {"y": y.name, "unit": y.unit, "time": time_unit, "u": u.name, "u_unit": u.unit}
        if self.beside is not None:
            beside = self.plant.states[self.beside]
            words |= {"beside": beside.name, "beside_unit": beside.unit}
        if self.alarm is not None:
            words["alarm"] = f"{self.alarm[0]:.4g} to {self.alarm[1]:.4g} {y.unit}".rstrip()
        found = []
        for name in self._kpi_names:
            title, unit, about = (text.format(**words).strip() for text in _TEXTS[name])
            resolution = 0.1 if name == "overshoot" else None
            found.append(KPI(name, title, unit, better="lower", about=about, resolution=resolution))
        return tuple(found)

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
        """Return noise and bias of the measured states at every instant, shape (K, n_y)."""
        assert self.task.noise is not None
        drawn = np.random.default_rng(seed).standard_normal((len(self.t), len(self.task.noise)))
        made = np.asarray(drawn * self.task.noise)
        return made if self.task.bias is None else made + self.task.bias

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
        except np.linalg.LinAlgError:  # there is no controller: no states and no steps
            x, u = np.zeros((0, len(self.plant.states))), np.zeros((0, len(self.plant.inputs)))
            none = np.zeros(0)
            response = LoopResponse(x, u, none.astype(np.int64), none, none.astype(np.bool_))
        return self._experiment(theta, response, hold)

    def scenario(self) -> Scenario:
        """Return the loop as a scenario."""
        return Scenario(
            name=self.name,
            title=self.title,
            space=self.space.described({name: about_knob(name) for name in self.space.names}),
            run=Function(self.run, self.varied),
            kpis=self.kpis,
            panels=(*self._state_panels(), *(Panel(c.name) for c in self.plant.inputs)),
            brief=brief_of(self.brief, self.plant.states),
            simulated=True,
        )

    def varied(self, space: KnobSpace | None = None) -> Varied:
        """Return what varies of the loop whose θ are in `space`; a model in its controller stays."""
        plant, law = self.plant, isinstance(self.controller, TunedPID | TunedLQR)
        limits, targets = [plant.states[k] for k in plant.measured], enumerate(np.ravel(self.target.start))
        moves = moves_of(plant, self.task, limits, list(targets))
        loop = VariedLoop(
            plant, self.task, partial(self._built, space), self.controller_of, wears=law, moves=moves
        )
        ideal = "resolution of sensors, backlash", "they are not simulated for an MPC of these loops"
        return loop.varied(*([] if law else [ideal]))

    def _built(
        self,
        space: KnobSpace | None,
        plant: Disturbed,
        task: Task,
        grain: Float[np.ndarray, " n_y"],
        play: Float[np.ndarray, " n_u"],
    ) -> Function:
        """Return the same loop with another plant and task, whose sensors and actuators are worn."""
        assert isinstance(plant.plant, CompiledPlant)
        actuators = self.actuators or (Actuator(),) * len(play)
        worn = (replace(a, backlash=a.backlash + p) for a, p in zip(actuators, play.tolist(), strict=True))
        made = replace(
            self,
            plant=replace(plant.plant, inputs=plant.inputs),
            task=task,
            controller=Designed(self.controller, self.plant, self.task),
            actuators=tuple(worn) if play.any() else self.actuators,
            resolution=tuple(np.maximum(grain, self.resolution or 0.0)) if grain.any() else self.resolution,
        )
        return Function(partial(made.run, space=space))

    def controller_of(self, theta: Float[np.ndarray, " n"]) -> Controller:
        """Return the controller of a physical θ, shape (n,).

        Raises:
            SettingsError: If its input has stages, which no linear law has.
        """
        if self.staged:
            raise SettingsError("an input in stages has no linear law")
        plant, values = self.plant, dict(zip(self.space.names, theta.tolist(), strict=True))
        T_s = values.get("T_s", self.task.T_s) * values.get("every", 1.0)
        T_s = max(round(T_s / plant.max_step), 1) * plant.max_step
        made = self.controller.make(values, plant, self.task, T_s)
        return LawController(made, T_s) if isinstance(made, Gains) else made

    def _respond(self, values: KnobValues, hold: int, seed: int) -> LoopResponse:
        """Return what the controller with these values of the knobs does."""
        made = self.controller.make(values, self.plant, self.task, hold * self.plant.max_step)
        if isinstance(made, Gains):
            return self.by_law(made, hold, seed)
        return self.by_controller(made, hold, seed)

    def by_law(self, gains: Gains, hold: int, seed: int) -> LoopResponse:
        """Return what a compiled law does that acts every `hold` steps."""
        plant, task = self.plant, self.task
        x, u, valid = simulate(
            (*plant.packed, np.array(plant.measured, dtype=np.int64)),
            (*gains, self._actuator_rows(), np.array(self.resolution, dtype=float)),
            (self._y_ref, self._d, self.noise(seed)),
            (plant.max_step, hold, self._delay, task.lag),
            (task.x0.copy(), task.u0.copy(), limits_of(plant.states)),
        )
        steps = len(range(0, max(valid - 1, 0), hold))  # the last instant decides none
        none, all_ = np.zeros(steps), np.ones(steps, np.bool_)
        return LoopResponse(x[:valid], u[:valid], none.astype(np.int64), none, all_)

    def by_controller(
        self, controller: Controller, hold: int, seed: int, clock: Callable[[], float] = time.perf_counter
    ) -> LoopResponse:
        """Return what `controller` does; where it does not solve its problem, the input is held.

        Its sampling time is `hold` steps. Sensors have no resolution, and actuators neither backlash nor
        stiction. Only the duration of its steps needs the `clock`, which returns seconds.
        """
        plant, t, noise = self.plant, self.t, self.noise(seed)
        (low, high), measured = limits_of(plant.inputs).T, list(plant.measured)
        reference, disturbance = self._y_ref, self._d
        x, u = np.zeros((len(t), len(plant.states))), np.zeros((len(t), len(plant.inputs)))
        history = (x, u, self.task.u0.copy(), disturbance, self.task.u0.copy())
        safe, timing = limits_of(plant.states), (plant.max_step, self._delay, self.task.lag)
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
            valid, stopped = advance(plant.packed, timing, (k, last), history, safe)
            if stopped:
                break
        each = (np.array(column) for column in zip(*steps, strict=True))
        return LoopResponse(x[:valid], u[:valid], *each)

    @property
    def _delay(self) -> int:
        """Number of steps of dead time of the inputs."""
        return round(self.plant.dead_time / self.plant.max_step)

    def _actuator_rows(self) -> Float[np.ndarray, "m 4"]:
        """Return stiction, backlash, resolution and lowest position of each input, shape (n_u, 4)."""
        pairs = zip(self.actuators, self.plant.inputs, strict=False)
        rows = [(a.stiction, a.backlash, a.resolution, c.low) for a, c in pairs]
        return np.array(rows, dtype=float).reshape(-1, 4)

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

    def _experiment(self, theta: Float[np.ndarray, " n"], response: LoopResponse, hold: int) -> Experiment:
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
            low, high = self.alarm
            y = bare.output(0)
            assert y is not None
            values["alarm"] = float(np.diff(bare.t)[((y < low) | (y > high))[:-1]].sum())
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
    signals, timing = f"UniTuple({matrix}, 3)", "Tuple((f8, i8, i8, f8))"
    types = f"(Tuple((i8, {vector}, i8[::1])), {control}, {signals}, {timing}, {start})"
    yield Kernel("closed loop", simulate, types)


compile_ahead(__name__, _kernels)
