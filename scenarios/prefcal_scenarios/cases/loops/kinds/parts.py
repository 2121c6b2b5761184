"""What the makers of the loops share: parameters, knobs and the usual task."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from prefcal_env.envs.step_signal import StepSignal
from prefcal_env.envs.task import Task
from prefcal_env.knobs.knob import Knob
from prefcal_env.knobs.space import KnobSpace
from prefcal_scenarios.cases.loops.plant import CompiledPlant
from prefcal_scenarios.described.words import knob_of, listed

CASCADE = ("_outer", "_inner")
"""Suffixes of the knobs of a cascade."""
Vary = Callable[[float], float]
"""Function that returns the value to use in place of a positive nominal one."""


def nominal(value: float) -> float:
    """Return `value` itself: so the named loops are made."""
    return value


def step_task(
    plant: CompiledPlant,
    horizon: float,
    T_s: float,
    *,
    x0: Sequence[float],
    u0: Sequence[float],
    target: float,
    d: tuple[float, float],
    noise: Sequence[float],
) -> Task:
    """Return the task of a loop: references step at the start, and halfway a disturbance sets in.

    Args:
        plant: Plant of the loop.
        horizon: Duration of an experiment, in the plant's unit of time.
        T_s: Sampling time of the controller; a knob called T_s replaces it. It is rounded to a
            multiple of the plant's step.
        x0: State at the start, a steady one, n_x numbers.
        u0: Inputs at the start, n_u numbers.
        target: Reference of the first measured state; those of the others are where they start.
        d: Disturbance before and after it sets in.
        noise: Standard deviation of the noise of each measured state.
    """
    return Task(
        x0=np.array(x0, dtype=float),
        u0=np.array(u0, dtype=float),
        y_ref=StepSignal((target, *(x0[i] for i in plant.measured[1:]))),
        d=StepSignal(d[:1], ((horizon / 2, d[1:]),)),
        noise=np.array(noise, dtype=float),
        horizon=horizon,
        T_s=T_s,
        dense_step=plant.max_step,
    )


def knobs(text: str, *more: Knob) -> KnobSpace:
    """Return the space of knobs as in a scenario file, "K=0.1:20:log %/°C, b=0:1", and of `more`."""
    read = [knob_of(each) for each in listed([text])]
    own = [k if k.integer else replace(k, low=float(k.low), high=float(k.high)) for k in read]
    return KnobSpace([*own, *more])
