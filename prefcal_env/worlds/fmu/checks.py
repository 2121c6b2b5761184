"""Check knobs, curves and times of a loop against its FMU, before anything runs."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import ceil, floor, isfinite

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import KnobError, PlantError
from prefcal_env.knobs.knob import Knob, is_number
from prefcal_env.wording import did_you_mean

from .model import Model, Variable, in_unit, listed
from .units import plain

_POINTS = 500
"""Number of intervals to record if neither the caller nor the FMU names a step."""
_MOST = 2_000
"""Largest number of intervals to record, unless the caller asks for more."""
_ROUNDING = 1e-9
"""Relative error of a ratio of times that counts as a whole number."""

Names = Mapping[str, str] | Sequence[str]
"""Variables of the FMU, perhaps by the names that they are shown with."""


def shown(model: Model, outputs: Names, inputs: Names) -> tuple[dict[str, Variable], dict[str, Variable]]:
    """Return outputs and inputs by the names that they are shown with, in the units asked for.

    Raises:
        PlantError: If there is no output, one is no variable of the FMU, or a name appears twice.
    """
    found = _named(model, "outputs", outputs), _named(model, "inputs", inputs)
    if not outputs:
        raise PlantError("outputs must name one or more variables of the FMU")
    if twice := sorted(found[0].keys() & found[1].keys()):
        raise PlantError(f"{twice[0]!r} cannot be both an output and an input: name it once")
    return found


def _named(model: Model, what: str, names: Names) -> dict[str, Variable]:
    if isinstance(names, str):
        raise PlantError(f"{what} must be a sequence of names, got {names!r}: write [{names!r}]")
    if isinstance(names, Mapping):
        pairs = list(names.items())
    else:
        pairs = [(in_unit(n)[0] if isinstance(n, str) else n, n) for n in names]
    for pair in pairs:
        if not all(isinstance(name, str) and name for name in pair):
            raise PlantError(f"{what} must hold names of variables, got {pair[0]!r}: {pair[1]!r}")
    found = dict(pairs)
    if len(found) < len(pairs):
        raise PlantError(f"{what} must differ, got {[shown for shown, _ in pairs]}")
    return {name: model.variable(variable) for name, variable in found.items()}


def tuned(model: Model, knobs: Mapping[str, Knob] | Sequence[Knob]) -> dict[str, Knob]:
    """Return knobs by the name of their parameter, with the units and descriptions of the FMU.

    Raises:
        KnobError: If there is none, or one is not a parameter of the FMU that can be set, has
            another unit, leaves the parameter's range, or is not an integer as the parameter is.
    """
    pairs = list(knobs.items() if isinstance(knobs, Mapping) else [(k.name, k) for k in knobs])
    if not pairs:
        there = listed(v.name for v in model.parameters)
        raise KnobError(f"FMU {model.path.name!r} needs one or more knobs; it can tune {there}")
    names = [name for name, _ in pairs]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise KnobError(f"each parameter can have one knob, got {twice} more than once")
    return {name: _tuned(model, name, knob) for name, knob in pairs}


def _tuned(model: Model, name: str, knob: Knob) -> Knob:
    variable = model.variables.get(name)
    able = [v.name for v in model.parameters]
    if variable is None:
        hint = did_you_mean(name, able) or f" It can tune {listed(able)}"
        raise KnobError(f"FMU {model.path.name!r} has no parameter {name!r}.{hint}")
    if not variable.tunable:
        raise KnobError(
            f"knob {knob.name!r}: {name!r} is not a tunable or fixed parameter of the FMU, but "
            f"causality {variable.causality}, variability {variable.variability}: export it as a "
            f"tunable parameter, or tune {listed(able)}"
        )
    given = variable.within(knob.unit)
    if given is None:
        raise KnobError(
            f"knob {knob.name!r}: its unit must be {variable.every_unit} as in the FMU, got "
            f"{knob.unit!r}: convert its range"
        )
    _check_range(knob, given)
    unit = next((u for u in (knob.unit, given.unit) if plain(u)), "")
    return replace(knob, unit=unit, about=knob.about or variable.about)


def _check_range(knob: Knob, variable: Variable) -> None:
    if knob.low < variable.low or knob.high > variable.high:
        range_ = f"[{knob.low:g}, {knob.high:g}]"
        raise KnobError(f"knob {knob.name!r}: its range must lie in {variable.limits}, got {range_}")
    if variable.whole and not knob.integer:
        raise KnobError(f"knob {knob.name!r}: the FMU's type is {variable.type}, so it needs integer=True")


def referenced(
    model: Model, outputs: Mapping[str, Variable], reference: Mapping[str, float | str] | None
) -> tuple[dict[str, float], dict[str, Variable]]:
    """Return the references that are numbers, and those that are variables, by shown output.

    Raises:
        PlantError: If one is of no shown output, is no finite number, or no variable.
    """
    numbers: dict[str, float] = {}
    variables: dict[str, Variable] = {}
    for name, value in (reference or {}).items():
        if name not in outputs:
            raise PlantError(
                f"reference {name!r} is not among the outputs {listed(outputs)}."
                + did_you_mean(name, outputs)
            )
        if isinstance(value, str):
            variables[name] = _alike(model.variable(value), name, outputs[name])
        elif is_number(value) and isfinite(value):
            numbers[name] = float(value)
        else:
            raise PlantError(
                f"reference of {name!r} must be a finite number or the name of a variable of the "
                f"FMU, got {value!r}"
            )
    return numbers, variables


def _alike(variable: Variable, name: str, output: Variable) -> Variable:
    """Return the variable of a reference in the unit of its output."""
    found = variable.within(output.unit)
    if found is None:
        raise PlantError(
            f"reference {variable.name!r} is in {variable.unit}, and {name!r} in {output.unit}: "
            "show the output in the unit of its reference, or name another variable"
        )
    return found


def grid_of(
    model: Model, stop_time: float | None, output_interval: float | None
) -> tuple[Float[np.ndarray, " M"], int]:
    """Return when the FMU communicates, in seconds, shape (M,), and every how many times to record.

    The first instant is the start, the last one the end, which is always recorded. The FMU
    communicates at its own step, if it declares one, so that what is recorded changes nothing about
    the simulation. Otherwise it communicates whenever it is recorded.

    Raises:
        PlantError: If there is no stop time, it is not after the start, or the interval is not
            above 0.
    """
    start, stop = model.start_time, model.stop_time if stop_time is None else stop_time
    if stop is None:
        raise PlantError(f"FMU {model.path.name!r} declares no stop time: give stop_time, in seconds")
    if not (is_number(stop) and isfinite(stop) and stop > start):
        raise PlantError(f"stop_time must be above the start time {start:g} s, got {stop!r} s")
    if output_interval is not None and not (
        is_number(output_interval) and 0 < output_interval <= stop - start
    ):
        raise PlantError(
            f"output_interval must be above 0 s and at most {stop - start:g} s, got {output_interval!r}"
        )
    step, every = _step(model, stop - start, output_interval)
    count = (stop - start) / step
    whole = floor(count + _ROUNDING * count)
    instants = start + step * np.arange(max(whole, 0) + 1)
    if ceil(count - _ROUNDING * count) > whole and (model.variable_step or not whole):
        instants = np.append(instants, stop)  # a last, shorter step
    return instants, every


def _step(model: Model, length: float, interval: float | None) -> tuple[float, int]:
    """Return the time between two communications, in seconds, and every how many to record."""
    if model.step is None:
        return (interval or length / _POINTS), 1
    step = min(model.step, length)
    if interval is None:
        return step, ceil(length / step / _MOST - _ROUNDING)
    ratio = interval / step
    every = round(ratio)
    if every >= 1 and abs(ratio - every) <= _ROUNDING * ratio:
        return step, every
    return interval / ceil(ratio), ceil(ratio)
