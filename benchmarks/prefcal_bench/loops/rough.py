"""The family of rough loops, called "rough-SEED": some θ fail, and some KPIs have plateaus."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
from jaxtyping import Float

from prefcal_env.envs.task import StepSignal
from prefcal_env.errors import ScenarioError
from prefcal_env.experiments.experiment import End, Experiment
from prefcal_env.knobs import Knob, KnobSpace
from prefcal_scenarios.cases.loops import LOOPS
from prefcal_scenarios.cases.loops.family import judged
from prefcal_scenarios.cases.loops.loop import Actuator, Loop, TunedPID
from prefcal_scenarios.scenario import Scenario

from .family import checked_seed, is_worth_tuning, random, varied

_TRIES = 30  # how often a rough loop is drawn at most
_FAIL = (0.05, 0.4)  # share of random θ that fail
_WANTED = (0.09, 0.34)  # the same where it can be chosen, so that it is kept with other random θ
_CALM = (0.5, 0.7)  # share of the safe θ that never cause an alarm
_SAMPLE = 128
_PREDICTIVE = "mpc-"
_OFTEN = 0.6  # chance of each kind of roughness
_STAGED = 0.4  # chance that the input of a single PID has stages
_STICTION, _BACKLASH, _STEPS = (0.02, 0.25), (0.02, 0.2), (0.05, 0.4)
"""Ranges of stiction, half the backlash and resolution, as shares of the usual move of an input."""
_RESOLUTION = (0.003, 0.03)
"""Range of the resolution of the sensors, as a share of the usual change of what they measure."""
_BACK = (0.4, 0.8)  # share of the first step that the second one goes back


def rough_loop(seed: int) -> Scenario:
    """Return the rough loop with this seed as a scenario, called "rough-SEED".

    The seed determines the kind, uniform over the loops without an MPC, the parameters as those of
    `loop`, and what is rough: actuators that stick, have play or stand at steps; sensors with
    a resolution; a second set point; an input in stages; how often the controller acts. Limits
    of safe operation are such that 5 to 40 % of random θ fail, and there is an alarm that more
    than half of the others never cause. All are drawn again until the loop `is_worth_tuning`, at
    most 30 times.

    Raises:
        ScenarioError: If the seed is not an integer of 0 or more, or no draw is worth tuning.
    """
    return judged(accepted(checked_seed(seed)))


@lru_cache(maxsize=256)  # the check takes up to a second
def accepted(seed: int) -> Loop:
    """Return the first draw with this seed that is worth tuning."""
    rng = np.random.default_rng([seed, 1])
    makers = [make for name, make in LOOPS.items() if not name.startswith(_PREDICTIVE)]
    for _ in range(_TRIES):
        smooth = varied(makers[int(rng.integers(len(makers)))], random(rng))
        found = _drawn(smooth, rng)
        if found is not None and is_worth_tuning(found):
            title = f"{found.title}, rough (variant {seed})"
            return replace(found, name=f"rough-{seed}", title=title)
    raise ScenarioError(f"none of {_TRIES} draws of the rough loop {seed} is worth tuning")


def _drawn(smooth: Loop, rng: np.random.Generator) -> Loop | None:
    """Return a rough loop around a smooth one; None if too many or too few of its θ fail."""
    wanted, calm = rng.uniform(*_WANTED), rng.uniform(*_CALM)
    safe = [run for run in _runs(smooth) if run.end is End.TIME_UP]
    if not safe:
        return None
    rough = roughened(smooth, safe, rng)
    beyond = np.array([_beyond(rough, run) for run in _runs(rough)])
    room = float(np.quantile(beyond, 1.0 - wanted, method="lower"))
    if 0 < room < np.inf:  # else so many fail as it is, or the targets themselves would be unsafe
        rough = _within(rough, room)
        beyond[beyond > room] = np.inf
    failed = np.isinf(beyond)
    if not _FAIL[0] <= failed.mean() <= _FAIL[1]:
        return None
    level = float(np.quantile(beyond[~failed], calm))
    low, high = _targets(rough)
    return replace(rough, alarm=(low - level, high + level))


def _runs(loop: Loop) -> list[Experiment]:
    """Return experiments of random θ, the same ones each time."""
    points = np.random.default_rng(0).random((_SAMPLE, len(loop.space)))
    space = loop.space
    return [loop.run(space.decode(z)) for z in space.snap_all(space.scaled(points))]


def _targets(loop: Loop) -> tuple[float, float]:
    """Return the lowest and the highest value between start and targets."""
    later = [values[0] for _, values in loop.target.steps]
    values = (float(loop.task.x0[loop.plant.measured[0]]), loop.target.start[0], *later)
    return min(values), max(values)


def _beyond(loop: Loop, run: Experiment) -> float:
    """Return how far the output goes beyond its targets; infinite if the run was interrupted."""
    if run.end is not End.TIME_UP:
        return float("inf")
    (low, high), y = _targets(loop), run.x[:, loop.plant.measured[0]]
    return float(max(low - y.min(), y.max() - high, 0.0))


def _within(loop: Loop, room: float) -> Loop:
    """Return the loop in which the output must stay within `room` of its targets to be safe."""
    (low, high), first = _targets(loop), loop.plant.measured[0]
    states = list(loop.plant.states)
    states[first] = replace(
        states[first], low=max(states[first].low, low - room), high=min(states[first].high, high + room)
    )
    return replace(loop, plant=replace(loop.plant, states=tuple(states)))


def roughened(loop: Loop, runs: list[Experiment], rng: np.random.Generator) -> Loop:
    """Return `loop` with random roughness, at least that of its actuators, and integer knobs.

    Sizes are shares of how much inputs and measured states usually move in `runs`.
    """
    inputs = np.median([run.u.std(axis=0) for run in runs], axis=0)
    measured = np.median([np.ptp(run.x[:, list(loop.plant.measured)], axis=0) for run in runs], axis=0)
    single = isinstance(loop.controller, TunedPID) and len(loop.controller.suffixes) == 1
    staged = single and not loop.staged and rng.random() < _STAGED
    found = _stages(loop, rng) if staged else loop
    knobs = [*found.space.knobs]
    if "T_s" not in found.space.names:
        knobs.append(Knob("every", 1, int(rng.integers(3, 13)), integer=True))
    return replace(
        found,
        space=KnobSpace(knobs),
        actuators=_actuators(found, np.maximum(inputs, 1e-9), rng),
        resolution=_resolution(np.maximum(measured, 1e-9), rng),
        task=replace(found.task, y_ref=_reference(found, rng)),
    )


def _stages(loop: Loop, rng: np.random.Generator) -> Loop:
    """Return the loop with an input in stages, whose number is a knob."""
    assert isinstance(loop.controller, TunedPID)
    fixed = {**loop.controller.fixed, "hysteresis": float(rng.uniform(0.0, 0.4))}
    few = int(rng.integers(4, 9))
    return replace(
        loop,
        controller=replace(loop.controller, fixed=fixed),
        space=KnobSpace([*loop.space.knobs, Knob("stages", few, 4 * few, integer=True)]),
        staged=True,
    )


def _actuators(
    loop: Loop, usual: Float[np.ndarray, " n_u"], rng: np.random.Generator
) -> tuple[Actuator, ...]:
    found = []
    for channel, size in zip(loop.plant.inputs, usual, strict=True):
        stiction, backlash, step = (size * _draw(rng, share) for share in (_STICTION, _BACKLASH, _STEPS))
        whole = channel.high - channel.low
        steps = 0.0 if loop.staged else whole / max(round(whole / step), 2)
        kept = rng.random(3) < _OFTEN
        kept[int(rng.integers(2))] = True  # friction or play there always is
        found.append(Actuator(*(float(v) for v in np.where(kept, (stiction, backlash, steps), 0))))
    return tuple(found)


def _resolution(usual: Float[np.ndarray, " n_m"], rng: np.random.Generator) -> tuple[float, ...]:
    if rng.random() >= _OFTEN:
        return ()
    return tuple(float(size * _draw(rng, _RESOLUTION)) for size in usual)


def _reference(loop: Loop, rng: np.random.Generator) -> StepSignal:
    """Return a second set point half of the time or more, between the start and the first one."""
    start, (target, *others) = float(loop.task.x0[loop.plant.measured[0]]), loop.target.start
    time = loop.disturbed_at * float(rng.uniform(0.5, 0.6))
    back = float(rng.uniform(*_BACK))
    second = (time, (target - back * (target - start), *others))
    return replace(loop.target, steps=(second,) if rng.random() < _OFTEN else ())


def _draw(rng: np.random.Generator, ends: tuple[float, float]) -> float:
    """Return a number between two others, uniform in the logarithm."""
    return float(np.exp(rng.uniform(*np.log(ends))))
