"""Make a loop rough: its actuators stick and have play, its sensors and set points have steps."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from prefcal_env.experiments.experiment import Experiment
from prefcal_env.knobs.knob import Knob
from prefcal_env.knobs.space import KnobSpace
from prefcal_scenarios.cases.loops.controllers import PID
from prefcal_scenarios.cases.loops.loop import Actuator, Loop

_OFTEN = 0.6
"""Chance of each kind of roughness."""
_STAGED = 0.4
"""Chance that the input of a single PID has stages."""
_STICTION, _BACKLASH, _STEPS = (0.02, 0.25), (0.02, 0.2), (0.05, 0.4)
"""Ranges of stiction, half the backlash and resolution, as shares of the usual move of an input."""
_RESOLUTION = (0.003, 0.03)
"""Range of the resolution of the sensors, as a share of the usual change of what they measure."""
_BACK = (0.4, 0.8)
"""Share of the first step that the second one goes back."""


@dataclass(frozen=True, slots=True)
class Usual:
    """How much usual runs move.

    Args:
        inputs: Standard deviation of each input, in its unit, shape (n_u,), above 0.
        measured: Largest change of each measured state, in its unit, shape (n_m,), above 0.
    """

    inputs: Float[np.ndarray, " n_u"]
    measured: Float[np.ndarray, " n_m"]


def usual_of(loop: Loop, runs: list[Experiment]) -> Usual:
    """Return the medians over `runs`, of which there is at least one, with a record."""
    inputs = np.median([run.u.std(axis=0) for run in runs], axis=0)
    measured = np.median([np.ptp(run.x[:, list(loop.measured)], axis=0) for run in runs], axis=0)
    return Usual(np.maximum(inputs, 1e-9), np.maximum(measured, 1e-9))


def roughened(loop: Loop, usual: Usual, rng: np.random.Generator) -> Loop:
    """Return `loop` with random roughness, at least that of its actuators, and integer knobs."""
    staged = _stages(loop, rng) if _may_have_stages(loop) and rng.random() < _STAGED else loop
    knobs = [*staged.space.knobs]
    if "T_s" not in staged.space.names:
        knobs.append(Knob("every", 1, int(rng.integers(3, 13)), integer=True))
    return replace(
        staged,
        space=KnobSpace(knobs),
        actuators=_actuators(staged, usual, rng),
        resolution=_resolution(usual, rng),
        task=replace(staged.task, program=_program(staged, rng)),
    )


def _may_have_stages(loop: Loop) -> bool:
    single = isinstance(loop.controller, PID) and len(loop.inputs) == 1
    return single and not loop.staged


def _stages(loop: Loop, rng: np.random.Generator) -> Loop:
    """Return the loop with an input in stages, whose number is a knob."""
    assert isinstance(loop.controller, PID)
    fixed = {**loop.controller.fixed, "hysteresis": float(rng.uniform(0.0, 0.4))}
    few = int(rng.integers(4, 9))
    return replace(
        loop,
        controller=replace(loop.controller, fixed=fixed),
        space=KnobSpace([*loop.space.knobs, Knob("stages", few, 4 * few, integer=True)]),
        staged=True,
    )


def _actuators(loop: Loop, usual: Usual, rng: np.random.Generator) -> tuple[Actuator, ...]:
    found = []
    for channel, size in zip(loop.inputs, usual.inputs, strict=True):
        stiction, backlash, step = (
            size * _within(rng, share) for share in (_STICTION, _BACKLASH, _STEPS)
        )
        whole = channel.high - channel.low
        steps = 0.0 if loop.staged else whole / max(round(whole / step), 2)
        kept = rng.random(3) < _OFTEN
        kept[int(rng.integers(2))] = True  # friction or play there always is
        found.append(Actuator(*(float(v) for v in np.where(kept, (stiction, backlash, steps), 0))))
    return tuple(found)


def _resolution(usual: Usual, rng: np.random.Generator) -> tuple[float, ...]:
    if rng.random() >= _OFTEN:
        return ()
    return tuple(float(size * _within(rng, _RESOLUTION)) for size in usual.measured)


def _program(loop: Loop, rng: np.random.Generator) -> tuple[tuple[float, float], ...]:
    """Return a second set point half of the time or more, between the start and the first one."""
    start, target = loop.task.x0[loop.measured[0]], loop.task.target[0]
    time = loop.timing.disturbed_at * float(rng.uniform(0.5, 0.6))
    back = float(rng.uniform(*_BACK))
    return ((time, target - back * (target - start)),) if rng.random() < _OFTEN else ()


def _within(rng: np.random.Generator, ends: tuple[float, float]) -> float:
    """Return a number between two others, uniform in the logarithm."""
    return float(np.exp(rng.uniform(*np.log(ends))))
