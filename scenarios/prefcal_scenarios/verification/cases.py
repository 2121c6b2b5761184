"""Find what of a source can vary: its loop, the arguments of its run, or what an optional world says."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from inspect import signature
from typing import Any

import numpy as np

from prefcal_env.envs.closed_loop import ClosedLoop
from prefcal_env.envs.cstr import cstr_env
from prefcal_env.envs.overtake import OvertakeOptions
from prefcal_env.errors import ScenarioError
from prefcal_env.knobs.knob import is_number
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.optional import world_of
from prefcal_env.sources.function import Function, function_of
from prefcal_env.sources.maneuvers import Maneuvers
from prefcal_env.sources.source import Source, WithKPIs
from prefcal_scenarios.cases.cstr.controller import controller
from prefcal_scenarios.cases.cstr.kpis import compute_kpis
from prefcal_scenarios.cases.loops.loop import Loop

from .compiled import of_loop
from .factor import Factor, Values, within
from .loops import of_closed_loop
from .plants import CHANGE, LEAST
from .subject import Subject, of_maneuvers

RIG = "it runs on a rig or a live plant, which cannot be varied: verify a model of it"
_OURS = ("theta", "seed", "space")


def subject_of(source: Source, space: KnobSpace) -> Subject:
    """Return what of a source can vary, for θ in `space`.

    Raises:
        ScenarioError: If nothing can; the message says what to add.
    """
    if isinstance(source, WithKPIs):
        return subject_of(source.source, space).measured_as(source)
    if isinstance(source, Maneuvers):
        return of_maneuvers(source, {n: subject_of(each, space) for n, each in source.maneuvers.items()})
    if source.asks:
        raise ScenarioError(RIG)
    function = function_of(source)
    bare = function.func if isinstance(function, partial) else function
    loop = getattr(bare, "__self__", bare)
    if isinstance(loop, Loop):
        return of_loop(loop, space)
    if isinstance(loop, ClosedLoop):
        return of_closed_loop(loop)
    world = world_of(loop)
    if world is not None and world.varies:
        varied: Subject = world.inside("prefcal_scenarios").subject_of(loop)
        return varied
    return _CASES.get(getattr(bare, "__module__", ""), of_function)(function)


def of_function(function: Any) -> Subject:
    """Return the numbers that a run takes as arguments with a default, besides θ and the seed.

    A whole one may be a count, which cannot change a little.
    """
    given = signature(function).parameters.values() if callable(function) else ()
    found = {p.name: p.default for p in given if p.name not in _OURS and is_number(p.default)}
    numbers = {name: float(value) for name, value in found.items() if isinstance(value, float)}
    whole = ", ".join(name for name in found if name not in numbers)
    said = ["only arguments of its run are varied: sensors, actuators and the task are in its code"]
    said += [f"whole numbers are not varied, write 2.0 for 2 where they can be: {whole}"] if whole else []
    if not numbers:
        raise ScenarioError(
            "nothing of it can be varied, since it is only a function of θ: give the parameters of its plant "
            "as arguments with a default, such as run(theta, seed=0, mass=1.2), or run it as a ClosedLoop"
        )
    return Subject(
        tuple(Factor.around(name, "parameter", CHANGE, value) for name, value in numbers.items()),
        tuple(said),
        partial(_with_arguments, function),
    )


def _with_arguments(function: Any, values: Values) -> Source:
    return Function(partial(function, **values))


def _reactor(function: Any) -> Subject:
    """Return what varies of the reactor; `function` is its run, perhaps for other ranges.

    An exponent changes the rate by e^0.3 for 1 %, and the gas constant does not change.
    """
    given = {k: v for k, v in getattr(function, "keywords", {}).items() if k == "space"}
    found = of_closed_loop(ClosedLoop(cstr_env(), partial(controller, **given), compute_kpis))
    return replace(found, factors=within(found.factors, {"E": 0.01, "R": 0.0}))


def _overtaking(function: Any) -> Subject:
    """Return the car's wheelbase, which the MPC does not know, and where it starts."""
    options = getattr(function, "keywords", {}).get("options") or OvertakeOptions()
    factors = (
        Factor.around("wheelbase", "parameter", CHANGE, options.wheelbase, "m", (LEAST, np.inf)),
        Factor("distance at the start", "task", 0.0, -5.0, 5.0, "m"),
        Factor("start beside the center line", "task", 0.0, -0.3, 0.3, "m"),
        Factor("heading at the start", "task", 0.0, -0.03, 0.03, "rad"),
    )
    said = "sensors and actuators of the car are ideal, and the obstacle drives as in the paper"
    return Subject(factors, (said,), partial(_in_scene, function, options, factors[1:]))


def _in_scene(function: Any, options: OvertakeOptions, start: tuple[Factor, ...], values: Values) -> Source:
    x, y, heading = (x + values.get(f.name, 0.0) for x, f in zip(options.x0, start, strict=True))
    wheelbase = values.get("wheelbase", options.wheelbase)
    return Function(partial(function, options=replace(options, x0=(x, y, heading), wheelbase=wheelbase)))


_CASES: Mapping[str, Callable[[Any], Subject]] = {
    "prefcal_scenarios.cases.cstr.scenario": _reactor,
    "prefcal_scenarios.cases.overtake.scenario": _overtaking,
}
"""What varies in the case studies, by the module of their run."""
