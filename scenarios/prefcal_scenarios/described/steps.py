"""The scenario of a plant whose references step one after the other, then loads act, and its KPIs."""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from copy import copy
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple, Protocol, Self

import numpy as np
from jaxtyping import Float

from prefcal_env.controllers.stored import as_data
from prefcal_env.envs.closed_loop import ClosedLoop
from prefcal_env.envs.plant_env import PlantEnv, delays_of
from prefcal_env.envs.task import StepSignal, Task, acts_at
from prefcal_env.envs.varied_loop import at_target, sample_of
from prefcal_env.errors import PlantError, ScenarioError
from prefcal_env.experiments.events import staying_time
from prefcal_env.experiments.experiment import Channel, Controller, Experiment
from prefcal_env.experiments.panels import Panel
from prefcal_env.knobs import Knob, KnobSpace
from prefcal_env.plants.plant import Disturbed, Plant
from prefcal_env.plants.systems import LinearPlant
from prefcal_env.units import conversion
from prefcal_env.wording import did_you_mean
from prefcal_scenarios.scenario import KPI, Scenario
from prefcal_scenarios.wording import number, quantity

from .design import Design, Single

# --- KPIs of loops: steps of the references, then loads on the inputs.

_DWELL = 3  # least number of samples in the band at the end
_BAND = 0.05  # band of settling and recovery, as a share of the step
_ROBUST = 2.0  # maximum sensitivity that is usual: a gain margin of 2 and a phase margin of 29 degrees


class Laws(Protocol):
    """The controllers of all θ, physical, shape (n,), and their linearized loops."""

    def make(self, theta: Float[np.ndarray, " n"]) -> Controller:
        """Return the controller of a θ."""

    def sensitivity(self, theta: Float[np.ndarray, " n"]) -> float:
        """Return the maximum sensitivity of the loop of a θ."""

    def around(self, plant: Plant, found: Design) -> Self:
        """Return the same controllers around another plant, which is linearized in `found`."""


@dataclass(frozen=True, slots=True, eq=False)
class Measure:
    """Function of an experiment that returns its KPIs."""

    design: Design  # what was chosen for the plant
    laws: Laws  # controllers of all θ
    there: Laws | None  # the same around the target, of a plant that is another one there

    @classmethod
    def of(cls, design: Design, laws: Laws, env: PlantEnv) -> "Measure":
        """Return the KPIs of a plant that is linearized in `design`."""
        task, there = at_target(env.plant, env.task), None
        if task is not None:
            with suppress(PlantError):  # such as one without a derivative there
                found = design.around(env.plant, task.x0, task.u0, task.disturbance(0.0))
                there = laws.around(env.plant, found)
        return cls(design, laws, there)

    @property
    def targets(self) -> list[tuple[int, float]]:
        """Return index and reference of each output that steps, in order; `ClosedLoop` asks for them."""
        return [(each.output, each.target) for each in self.design.loops]

    def around(self, env: PlantEnv) -> "Measure":
        """Return the same KPIs of another plant, which starts and steps as its task says."""
        plant, task = env.plant, env.task
        d, phase = task.disturbance(0.0), self.design.phase
        found, y = self.design.around(plant, task.x0, task.u0, d), plant.g(task.x0, task.u0, d)
        steps = ((loop, loop.output, task.reference(k * phase)) for k, loop in enumerate(found.loops))
        moved = (replace(loop, start=float(y[j]), target=float(r[j])) for loop, j, r in steps)
        found = replace(found, loops=tuple(moved), lag=task.lag)
        return Measure.of(found, self.laws.around(plant, found), env)

    def __call__(self, experiment: Experiment) -> dict[str, float]:
        """Return the KPIs by name; an infinite time means never."""
        found: dict[str, float] = {}
        for k, loop in enumerate(self.design.loops):
            if len(experiment.t) > 1:
                end = self.design.suffix(k)
                found |= {f"{n}{end}": v for n, v in self._values(experiment, loop, k).items()}
        return found | {"M_s": self.sensitivity(experiment.theta)}

    def sensitivity(self, theta: Float[np.ndarray, " n"]) -> float:
        """Return the maximum sensitivity of a physical θ, shape (n,): the larger one of start and target."""
        return max(laws.sensitivity(theta) for laws in (self.laws, self.there) if laws is not None)

    def _values(self, e: Experiment, loop: Single, k: int) -> dict[str, float]:
        """Return the values of loop k, whose step is after k phases; then the loads come."""
        y, t, phase, last = e.output(loop.output), e.t, self.design.phase, len(self.design.loops)
        assert y is not None
        start, end, loads = (self.design.acts(n, e.t_control) for n in (k, k + 1, last))
        own, late = (t >= start) & (t < end), t >= loads
        error = (y - loop.target) / loop.step
        arrived = bool(np.all(np.abs(error[~late][-1:]) <= _BAND))  # or a load may seem to help
        peak = abs(loop.step) * float(np.abs(error[late]).max()) if late.any() else np.inf
        rest = self.design.point.u[loop.input]  # the first move starts there
        moves = np.diff(e.u_control[:, loop.input], prepend=rest)
        return {
            "settling_time": _until(t, error, own, start, (k + 1) * phase),
            "overshoot": 100 * max(float(error[own].max(initial=0.0)), 0.0),
            "disturbance_peak": peak,
            "recovery": _until(t, error, late, loads, (last + 1) * phase) if arrived else np.inf,
            "total_move": float(np.abs(moves).sum()),
        }


def _until(
    t: Float[np.ndarray, " K"], error: Float[np.ndarray, " K"], part: np.ndarray, start: float, end: float
) -> float:
    """Return the time from `start` on until the error stays in the band: 0 if always, infinite for never.

    It must stay there for some samples: the last one of an oscillation is in the band by chance.
    """
    if not part.any() or t[-1] < end * (1 - 1e-6) - 1e-9:
        return np.inf
    t = t[part]
    found = staying_time(t, error[part], _BAND)
    if found == t[0]:  # it never left the band: the first sample may come after the start
        return 0.0
    return found - start if len(t) >= _DWELL and found <= t[-_DWELL] else np.inf


_ROWS = (
    (
        "settling_time",
        "settling time of {y} (within ±5 %)",
        "{time}",
        "Time after which it stays close to its reference.",
    ),
    ("overshoot", "overshoot of {y}", "%", "How far it goes beyond its reference, as a share of the step."),
    (
        "disturbance_peak",
        "peak error of {y} under the load",
        "{unit}",
        "Largest distance from the reference after the load sets in.",
    ),
    (
        "recovery",
        "recovery time of {y} (within ±5 %)",
        "{time}",
        "Time from the load until it stays close to its reference again; never, if it was not close when "
        "the load came.",
    ),
    ("total_move", "total move of {u}", "{u_unit}", "Sum of all changes of the input: wear of the actuator."),
)
"""Name, title, unit and meaning of the KPIs of each loop."""


def kpis_of(measure: Measure, outputs: tuple[Channel, ...], time: str, robust: float) -> tuple[KPI, ...]:
    """Return the KPIs, in order of importance; all are better if lower.

    The maximum sensitivity has an objective if `robust`, that of the start in the middle of the ranges,
    meets it: what the target asks for in addition, a lower gain can give.
    """
    found, design = list[KPI](), measure.design
    for k, loop in enumerate(design.loops):
        y, u = outputs[loop.output], loop.channel
        words = {"y": y.name, "unit": y.unit, "time": time, "u": u.name, "u_unit": u.unit}
        for name, title, unit, about in _ROWS:
            more = {"resolution": 0.1} if name == "overshoot" else {}
            end = design.suffix(k)
            found.append(_lower(f"{name}{end}", title.format(**words), unit.format(**words), about, **more))
    where = ", at start or target" if measure.there is not None else ""
    about = (
        f"Largest amplification of disturbances at any frequency, by the linearized loop{where}: 1.2 to 2 "
        "is usual, a large one is close to instability."
    )
    limit = _ROBUST if robust <= _ROBUST else np.inf
    peak = _lower("M_s", "maximum sensitivity M_s", "", about, at_most=limit, resolution=0.01, margin=True)
    return (*found, peak)


def _lower(name: str, title: str, unit: str, about: str, **more: Any) -> KPI:
    return KPI(name, title, unit, better="lower", about=about, **more)


class Mark(NamedTuple):
    """Where a stated limit is in a picture of an output: a band, a line of one value, or a time."""

    output: str  # name of the output
    low: float  # lowest value; -inf for a time
    high: float  # highest value; as `low` for a line
    first: float = -np.inf  # time from which on it counts
    last: float = np.inf  # time until which it counts; as `first` for a time


def marks_of(kpis: Sequence[KPI], run: Experiment, duration: float) -> list[Mark]:
    """Return where the stated limits of a run of steps are that lasts so long if nothing ends it.

    These are the bands around its own targets, limits of the overshoot, and times at which it must have
    settled and recovered.
    """
    outputs = {c.name: i for i, c in enumerate(run.channels.y) if c.target is not None}
    phase, found = duration / (len(outputs) + 1), list[Mark]()
    titles = {name: title for name, title, *_ in _ROWS}
    for kpi in (kpi for kpi in kpis if np.isfinite(kpi.at_most)):
        name = next((n for n in ("settling_time", "overshoot", "recovery") if kpi.name.startswith(n)), "")
        output = next((y for y in outputs if name and kpi.title == titles[name].format(y=y)), None)
        values = None if output is None else run.output(outputs[output])
        if output is None or values is None or not len(values):
            continue
        target, number = float(run.channels.y[outputs[output]].target or 0.0), kpi.name.rpartition("_")[2]
        step = target - float(values[0])
        start = len(outputs) if name == "recovery" else int(number) - 1 if number.isdigit() else 0
        first, last = (acts_at(n * phase, run.t_control) for n in (start, start + 1))
        if name == "overshoot":
            limit = target + kpi.at_most / 100 * step
            found.append(Mark(output, limit, limit, first, last))
            continue
        found.append(Mark(output, *sorted((target - _BAND * step, target + _BAND * step))))
        if (due := first + kpi.at_most) <= last:  # what has not settled by then never does
            found.append(Mark(output, -np.inf, np.inf, due, due))
    return list(dict.fromkeys(found))


# --- Make the scenario of a plant whose references step one after the other, then loads act.

_AWAY = 10.0  # distance from the start, in steps, at which an output has run away


def plant_of(plant: Any, horizon: float | None) -> Plant:
    """Return a plant or linear system as a plant, for experiments of a duration.

    Raises:
        PlantError: If it is neither.
        ScenarioError: If the duration is not above 0.
    """
    found: Plant = plant
    if not all(hasattr(plant, name) for name in ("hold", "inputs", "outputs", "states")):
        found = Plant.of(plant)
    if horizon is not None and not 0 < horizon < np.inf:
        raise ScenarioError(f"horizon must be above 0 {found.time_unit}, got {horizon}")
    return found


Factors = Float[np.ndarray, " n"]
"""What the values of the knobs are multiplied by to be in the plant's units, shape (n,)."""


def space_of(knobs: Sequence[Knob], own: Sequence[Knob], kind: str) -> tuple[KnobSpace, Factors]:
    """Return the space of `knobs`, where those of the same name in `own` replace them, and its factors.

    An own knob without a unit gets that of the knob that it replaces.

    Raises:
        ScenarioError: If an own knob has another name, or a unit that cannot be converted to the plant's.
    """
    names, given = [knob.name for knob in knobs], {knob.name: knob for knob in own}
    for name in given:
        if name not in names:
            raise ScenarioError(
                f"no knob of this {kind} is called {name!r}.{did_you_mean(name, names)} "
                f"Expected one of {names}"
            )
    chosen, factors = [], np.ones(len(knobs))
    for i, knob in enumerate(knobs):
        one = given.get(knob.name, knob)
        if one.unit:
            factors[i] = _factor(one, knob.unit or "1")
        chosen.append(replace(one, unit=one.unit or knob.unit, about=one.about or knob.about))
    return KnobSpace(chosen), factors


def _factor(knob: Knob, unit: str) -> float:
    """Return what values of an own knob are multiplied by to be in the plant's `unit`."""
    found = conversion(knob.unit, unit)
    expected = f"knob {knob.name!r}: its unit must be {unit}, as that of the plant, got {knob.unit}"
    if found is None:
        raise ScenarioError(expected)
    if found.factor != 1 and knob.name.startswith("K_p"):
        # Reports state gains in the plant's units beside it: one number, one unit.
        raise ScenarioError(f"{expected}: multiply its range by {found.factor:.6g}")
    return found.factor


def theta_of(space: KnobSpace, values: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Return values of the knobs, rounded and moved into their ranges, shape (n,)."""
    pairs = zip(space, values, strict=True)
    return np.array([knob.round(min(max(v, knob.low), knob.high)) for knob, v in pairs])


def name_of(plant: Plant, found: Design) -> str:
    """Return the name of a plant, or if nobody gave one, what is controlled by what."""
    if plant.name != "plant":
        return plant.name
    outputs, inputs = (
        (plant.outputs[k.output].name for k in found.loops),
        (k.channel.name for k in found.loops),
    )
    return f"{', '.join(outputs)} by {', '.join(inputs)}"


def scenario_of_steps(plant: Plant, found: Design, laws: Laws, space: KnobSpace, **said: Any) -> Scenario:
    """Return the scenario of a plant and its controllers.

    `said` is its name, title, references and brief: an empty brief is found, and the first
    reference is the middle of the ranges.
    """
    middle, inputs = next(iter(said["references"].values())), list(plant.inputs)
    for loop in found.loops:
        inputs[loop.input] = loop.channel
    loaded = Disturbed(plant, on_inputs=range(len(inputs)), inputs=tuple(inputs))
    env, assumed = PlantEnv(loaded, _task(plant, found)), tuple(_assumed_limits(plant, inputs))
    measure = Measure.of(found, laws, env)
    return Scenario(
        space=space,
        run=ClosedLoop(env, laws.make, measure),
        kpis=kpis_of(measure, plant.outputs, plant.time_unit, laws.sensitivity(middle)),
        panels=_panels(plant, found),
        controller=laws.make,
        settings=partial(_data, laws),
        simulated=True,
        assumed=assumed,
        **(said | {"brief": said["brief"] or _brief(plant, found, assumed)}),
    )


def _data(laws: Laws, theta: Float[np.ndarray, " n"]) -> dict[str, Any]:
    """Return the controller of a physical θ, shape (n,), as data, from which it can be made again."""
    return as_data(laws.make(theta))


def _task(plant: Plant, found: Design) -> Task:
    """Return the task: loop k steps after k phases, then the loads act."""
    n, phase, loads, unsafe = (
        len(found.loops),
        found.phase,
        np.zeros(len(plant.inputs)),
        RunsAway(plant, found),
    )
    y_ref = np.full((n, len(plant.outputs)), np.nan)
    for k, loop in enumerate(found.loops):
        y_ref[:k, loop.output], y_ref[k:, loop.output] = loop.start, loop.target
        loads[loop.input] = loop.load
    # A sampling instant may lie a rounding error before its time.
    starts = [(k - 1e-9) * phase for k in range(1, n + 1)]
    at_rest, loaded = (np.concatenate([found.point.d, part]) for part in (0 * loads, loads))
    return Task(
        x0=found.point.x,
        u0=found.point.u,
        y_ref=StepSignal(y_ref[0], tuple(zip(starts, y_ref[1:], strict=False))) if n > 1 else y_ref[0],
        d=StepSignal(at_rest, ((starts[-1], loaded),)),
        horizon=(n + 1) * phase,
        T_s=found.T_s,
        dense_step=found.T_s,
        unsafe=unsafe,
        vectorized=unsafe.vectorized,
        tracked=tuple(loop.output for loop in found.loops),
    )


class RunsAway:
    """Function of a state that tells whether an output has run away, or an output or state left its limits.

    Outputs are judged with the input at rest. So a limit on one does not count if its input acts on it at
    once, or if it has a dead time of its own: what is recorded then differs.

    Args:
        plant: Plant.
        design: What was chosen for it. What starts at or beyond a limit has none.
    """

    def __init__(self, plant: Any, design: Design) -> None:
        at = self._point = design.point
        self._limits = _within(plant.states, at.x)
        outputs = _within(plant.outputs, plant.g(at.x, at.u, at.d))
        self._outputs = [row for row in outputs if _is_seen(plant, at, row[0])]
        for loop in design.loops:
            reach = _AWAY * abs(loop.step)
            self._outputs.append((loop.output, loop.start - reach, loop.start + reach))
        self._take(plant)

    def _take(self, plant: Any) -> None:
        self._plant = plant
        self.vectorized = isinstance(plant, LinearPlant)
        """Whether it takes M states at once, as columns."""

    def around(self, plant: Plant) -> "RunsAway":
        """Return the same limits of another plant, whose outputs may follow otherwise from its states."""
        made = copy(self)
        made._take(plant.plant if isinstance(plant, Disturbed) else plant)
        return made

    def __call__(self, x: Float[np.ndarray, " *M"]) -> Any:
        """Return whether the experiment ends."""
        if self.vectorized:
            rest = self._plant.g(np.zeros(len(x)), self._point.u, self._point.d)
            seen = {k: self._plant.system.C[k] @ x + rest[k] for k, _, _ in self._outputs}
            away = np.zeros(x.shape[1:], dtype=bool)
            for values, limits in ((x, self._limits), (seen, self._outputs)):
                for k, low, high in limits:
                    away |= (values[k] < low) | (values[k] > high)
            return away
        # A few numbers at every instant: faster than array operations.
        if not all(low <= x[k] <= high for k, low, high in self._limits):
            return True
        y = self._plant.g(x, self._point.u, self._point.d).tolist()
        return not all(low <= y[k] <= high for k, low, high in self._outputs)


def _is_seen(plant: Any, point: Any, k: int) -> bool:
    """Return whether output `k` is what the states say, at the same instant."""
    if isinstance(plant, LinearPlant):
        direct = bool(plant.system.D[k].any())
    else:
        moved = point.u * (1 + 1e-6) + 1e-9
        direct = plant.g(point.x, moved, point.d)[k] != plant.g(point.x, point.u, point.d)[k]
    late = delays_of(plant)[1][k], *(getattr(plant, "entry_delay", ()) or [()] * (k + 1))[k]
    return not (direct or any(late))


def _within(channels: Sequence[Channel], starts: Float[np.ndarray, " n"]) -> list[tuple[int, float, float]]:
    """Return number and limits of the channels that have some and start within them."""
    found = [(k, c.low, c.high) for k, c in enumerate(channels) if c.low < starts[k] < c.high]
    return [(k, low, high) for k, low, high in found if np.isfinite(low) or np.isfinite(high)]


def _panels(plant: Plant, found: Design) -> tuple[Panel, ...]:
    """Return a panel for each output and input; limits far from the step would dwarf it."""
    panels = []
    for loop in found.loops:
        c, room = plant.outputs[loop.output], 2 * abs(loop.step)
        low = c.low if abs(c.low - loop.target) <= room else -np.inf
        high = c.high if abs(c.high - loop.target) <= room else np.inf
        panels.append(Panel(c.name, kind="y", low=low, high=high, target=loop.target))
    return (*panels, *(Panel(loop.channel.name, kind="u") for loop in found.loops))


def _assumed_limits(plant: Plant, inputs: Sequence[Channel]) -> Iterator[str]:
    """Yield the limits of the inputs of a loop that nobody stated of its plant, a sentence each."""
    guessed = (sample := sample_of(plant)) is not None and sample.guessed
    for own, c in zip(plant.inputs, inputs, strict=True):
        if guessed or (own.low, own.high) != (c.low, c.high):
            limits = f"{number(c.low)} to {quantity(c.high, c.unit)}"
            yield f"Nobody stated limits of {c.name}; {limits} is assumed."


def _beyond_record(plant: Plant, design: Design) -> Iterator[str]:
    """Yield where a step asks for more than the record of an identified plant has shown."""
    sample = sample_of(plant)
    if sample is None or not sample.moved:
        return
    for loop in design.loops:
        needs = abs(loop.step / loop.process.gain) if not loop.process.integrators else 0.0
        if needs > 1.05 * sample.moved:
            unit = loop.channel.unit
            asked, shown = (quantity(float(f"{v:.3g}"), unit) for v in (needs, sample.moved))
            yield (
                f"To rest there, {loop.channel.name} moves by {asked}, which is more than the {shown} of "
                f"{sample.record}: what the model says of that is not measured."
            )


def _brief(plant: Plant, design: Design, assumed: Sequence[str]) -> str:
    """Return the brief: steps, loads, what was assumed, and what to judge by."""
    time, said = plant.time_unit, list[str]()
    for k, loop in enumerate(design.loops):
        y, when = plant.outputs[loop.output], f"at {design.acts(k):.4g} {time}" if k else "at the start"
        target = f"{loop.target:.4g} {y.unit}".rstrip()
        said.append(f"The reference of {y.name} steps from {loop.start:.4g} to {target} {when}.")
    loads = [(f"{p.load:g} {p.channel.unit}".rstrip(), p.channel.name) for p in design.loops]
    acting = ", ".join(f"{load} on {name}" for load, name in loads)
    behind = " The dead time of the input does not delay it." if any(delays_of(plant)[0]) else ""
    said.append(f"From {design.acts(len(design.loops)):.4g} {time} on, a load acts: {acting}.{behind}")
    said.append(f"The controller moves every {design.T_s:g} {time}.")
    said += assumed
    for loop in design.loops:
        c = loop.channel
        if loop.way:
            absolute = getattr(plant, "rest", None) is not None
            said.append(
                f"The plant rests {'here' if absolute else 'only'} with {c.name} at its limit of "
                f"{loop.rest:g} {c.unit}".rstrip()
                + f", from where it can only {'rise' if loop.way > 0 else 'fall'}"
                + ("." if absolute else ": if its values are deviations, give it limits on both sides of 0.")
            )
    said += getattr(getattr(plant, "system", None), "cleaned", ())
    said += _beyond_record(plant, design)
    if (sample := sample_of(plant)) and sample.noise:
        noise = quantity(float(f"{sample.noise:.3g}"), plant.outputs[0].unit)
        said.append(
            f"The runs are without the record's noise of {noise}: a gain or derivative that is too large "
            f"moves {plant.inputs[0].name} with it, as verify shows."
        )
    said.append(
        "Good control reaches the reference soon, without overshoot or oscillation, rejects the "
        "load, and spares the actuator. What counts more is up to you."
    )
    return " ".join(said)
