"""A scenario made of nothing but a plant: its PID is tuned, everything else is found."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_env.controllers.decentralized import Decentralized
from prefcal_env.controllers.pid import PID
from prefcal_env.controllers.sampled import sampled
from prefcal_env.controllers.stored import as_data
from prefcal_env.envs.experiment_env import ClosedLoop
from prefcal_env.envs.plant_env import PlantEnv
from prefcal_env.envs.task import Task
from prefcal_env.errors import ScenarioError
from prefcal_env.experiments.experiment import Channel
from prefcal_env.experiments.panels import Panel
from prefcal_env.knobs.knob import Knob
from prefcal_env.plants.plant import Plant
from prefcal_scenarios.scenario import KPI, Scenario

from .pid.design import Design, N, design
from .pid.knobs import space_of, theta_of
from .pid.kpis import Measure, names_of
from .pid.loaded import Loaded
from .pid.words import brief_of

_AWAY = 10.0
"""Distance from the start, in steps, at which an output has run away."""


def pid_scenario(
    plant: Plant,
    *,
    knobs: Sequence[Knob] = (),
    reference: Mapping[str, float] | None = None,
    horizon: float | None = None,
    title: str = "",
    brief: str = "",
) -> Scenario:
    """Make the scenario of tuning a PID for `plant`: all that is not given is found.

    Found are a steady state to start from, the step of the reference, the sampling time, the
    duration, a load on the input in the second half, and ranges around a robust tuning that hold
    those of Skogestad and of Ziegler and Nichols where these rules apply. With several outputs,
    each gets a PID of its own, paired by the relative gain array; the references step one after
    the other.

    The knobs are K_p (without its sign), T_i, T_d and the set-point weight b; with several loops
    they are called K_p_1, T_i_1 and so on.

    Source: see `prefcal_env.controllers.rules` and `own.pid.design.pairs_of`.

    Args:
        plant: Plant, or a linear system that `Plant.of` takes.
        knobs: Knobs that replace those of the same name.
        reference: Reference after the step by output, in its unit; None for the channels' targets,
            or what a fifth of the input's range achieves. Only these outputs are controlled.
        horizon: Duration of an experiment, in the plant's unit of time; None to find it.
        title: Title for headings.
        brief: Description of the task for the person who compares.

    Raises:
        ScenarioError: If there is no steady state, a name does not exist, or no PID stabilizes the
            plant.
        PlantError: If `plant` is neither a plant nor a linear system.
    """
    if not all(hasattr(plant, name) for name in ("hold", "inputs", "outputs", "states")):
        plant = Plant.of(plant)
    if horizon is not None and not 0 < horizon < np.inf:
        raise ScenarioError(f"horizon must be above 0 {plant.time_unit}, got {horizon}")
    found = design(plant, reference, horizon)
    space = space_of(found, plant.outputs, plant.time_unit, knobs)
    make = MakePID(found, len(plant.inputs))
    rows = [loop.output for loop in found.loops]
    columns = [loop.input for loop in found.loops]
    square = found.J.part(rows, columns)
    delay = found.delay[np.ix_(rows, columns)]
    measure = Measure(found, sampled(square, found.T_s, delay), N)
    return Scenario(
        name="pid",
        title=title or f"PID of {plant.name}",
        space=space,
        run=ClosedLoop(PlantEnv(_loaded(plant, found), task_of(plant, found)), make, measure),
        kpis=kpis_of(found, plant.outputs, plant.time_unit),
        panels=_panels(plant, found),
        references=_references(found, space),
        controller=make,
        settings=Settings(make),
        brief=brief or brief_of(plant, found),
        simulated=True,
    )


@dataclass(frozen=True, slots=True, eq=False)
class MakePID:
    """Function of θ that makes the PID, or one for each loop."""

    design: Design
    n_u: int

    def __call__(self, theta: Float[np.ndarray, " n"]) -> PID | Decentralized:
        """Return the controller for a physical θ, shape (n,)."""
        rows = np.reshape(np.asarray(theta, dtype=float), (-1, 4)).tolist()
        pids = []
        for (K_p, T_i, T_d, b), loop in zip(rows, self.design.loops, strict=True):
            sign = float(np.sign(loop.center.K_p))
            c = loop.channel
            pids.append(
                PID(
                    sign * K_p, T_i, T_d, T_s=self.design.T_s, N=N, b=b, low=c.low, high=c.high,
                    output=loop.output, input=loop.input,
                )
            )  # fmt: skip
        return pids[0] if len(pids) == 1 else Decentralized(pids)


@dataclass(frozen=True, slots=True, eq=False)
class Settings:
    """Function of θ that returns the controller as data, from which it can be made again."""

    make: Callable[[Any], PID | Decentralized]

    def __call__(self, theta: Float[np.ndarray, " n"]) -> dict[str, Any]:
        """Return the controller's data for a physical θ, shape (n,)."""
        return as_data(self.make(theta))


def task_of(plant: Plant, found: Design) -> Task:
    """Return the task: one step for each loop, then the loads."""
    point, phase, n = found.point, found.phase, len(found.loops)
    start = np.full(len(plant.outputs), np.nan)
    schedule = Schedule(found, start, len(plant.inputs))
    alone = n == 1
    y_ref = start.copy()
    for loop in found.loops:
        y_ref[loop.output] = loop.target
    return Task(
        x0=point.x, u0=point.u, y_ref=y_ref if alone else schedule.reference,
        d=schedule.disturbance, horizon=(n + 1) * phase, T_s=found.T_s, dense_step=found.T_s,
        unsafe=RunsAway(plant, found),
        tracked=tuple(loop.output for loop in found.loops),
    )  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Schedule:
    """References and disturbances over time."""

    design: Design
    nothing: Float[np.ndarray, " n_y"]
    n_u: int

    def reference(self, t: float) -> Float[np.ndarray, " n_y"]:
        """Return the references at time `t`: loop k steps after k phases."""
        y_ref = self.nothing.copy()
        for k, loop in enumerate(self.design.loops):
            stepped = t >= (k - 1e-9) * self.design.phase
            y_ref[loop.output] = loop.target if stepped else loop.start
        return y_ref

    def disturbance(self, t: float) -> Float[np.ndarray, " n_d"]:
        """Return the measured disturbances, which rest, and the loads at time `t`."""
        loads = np.zeros(self.n_u)
        if t >= (len(self.design.loops) - 1e-9) * self.design.phase:
            for loop in self.design.loops:
                loads[loop.input] = loop.load
        return np.concatenate([self.design.point.d, loads])


@dataclass(frozen=True, slots=True, eq=False)
class RunsAway:
    """Function of a state that tells whether an output has run away or a state left its limits."""

    plant: Plant
    design: Design

    def __call__(self, x: Float[np.ndarray, " n_x"]) -> bool:
        """Return whether the experiment ends."""
        states, point = self.plant.states, self.design.point
        for channel, value, start in zip(states, x.tolist(), point.x.tolist(), strict=True):
            inside = channel.low < start < channel.high
            if inside and not channel.low <= value <= channel.high:
                return True
        y = self.plant.g(x, point.u, point.d)
        return any(
            abs(y[loop.output] - loop.start) > _AWAY * abs(loop.target - loop.start)
            for loop in self.design.loops
        )


def _loaded(plant: Plant, found: Design) -> Loaded:
    """Return the plant with loads, and with limits for every input."""
    inputs = list(plant.inputs)
    for loop in found.loops:
        inputs[loop.input] = loop.channel
    return Loaded(plant, tuple(inputs))


def _panels(plant: Plant, found: Design) -> tuple[Panel, ...]:
    """Return a panel for each output and input; limits far from the step would dwarf it."""
    panels = []
    for loop in found.loops:
        c, room = plant.outputs[loop.output], 2 * abs(loop.target - loop.start)
        low = c.low if abs(c.low - loop.target) <= room else -np.inf
        high = c.high if abs(c.high - loop.target) <= room else np.inf
        panels.append(Panel(c.name, kind="y", low=low, high=high, target=loop.target))
    return (*panels, *(Panel(loop.channel.name, kind="u") for loop in found.loops))


def _references(found: Design, space: Any) -> dict[str, Float[np.ndarray, " n"]]:
    """Return tunings by name: the robust one, and rules that apply to every loop."""
    named = {"robust": [loop.center for loop in found.loops]}
    for name in found.loops[0].known:
        if all(name in loop.known for loop in found.loops):
            named[name] = [loop.known[name] for loop in found.loops]
    return {name: theta_of(space, tunings) for name, tunings in named.items()}


def kpis_of(design: Design, outputs: tuple[Channel, ...], time_unit: str) -> tuple[KPI, ...]:
    """Return the KPIs, in order of importance; all are better if lower."""
    found: list[KPI] = []
    for k, loop in enumerate(design.loops):
        found += _of_loop(names_of(design, k), outputs[loop.output], loop.channel, time_unit)
    about = (
        "Largest amplification of disturbances at any frequency, by the linearized loop: 1.2 to 2 "
        "is usual, a large one is close to instability."
    )
    found.append(KPI("M_s", "sensitivity peak M_s", "", better="lower", about=about))
    return tuple(found)


def _of_loop(end: str, y: Channel, u: Channel, time: str) -> list[KPI]:
    return [
        KPI(f"settling_time{end}", f"settling time of {y.name} (within ±5 %)", time,
            better="lower", about="Time after which it stays close to its reference."),
        KPI(f"overshoot{end}", f"overshoot of {y.name}", "%", better="lower",
            about="How far it goes beyond its reference, as a share of the step."),
        KPI(f"disturbance_peak{end}", f"peak error of {y.name} under the load", y.unit,
            better="lower", about="Largest distance from the reference after the load sets in."),
        KPI(f"recovery{end}", f"recovery time of {y.name} (within ±5 %)", time, better="lower",
            about="Time from the load until it stays close to its reference again."),
        KPI(f"total_move{end}", f"total move of {u.name}", u.unit, better="lower",
            about="Sum of all changes of the input: wear of the actuator."),
    ]  # fmt: skip
