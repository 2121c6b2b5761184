"""Make a scenario of an FMU, with nothing but names and numbers."""

import os
import re
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from prefcal_env.errors import ScenarioError
from prefcal_env.knobs import Knob
from prefcal_env.workers import MARK
from prefcal_env.worlds.fmu import FMULoop, Model, Variable, in_unit, read_model
from prefcal_scenarios.described.description import Description
from prefcal_scenarios.scenario import Scenario

_SHOWN = 8  # number of outputs that are shown at most if none is named
_QUICK = 0.05  # longest simulation in seconds of an FMU of which many are simulated unseen
_PROBED = 2.0  # time limit of the simulation that is timed, in seconds
_ACTUATORS = re.compile(
    r"u\d*|mv|cmd|command|control|valve|heater|heating|pump|throttle|actuator|torque|voltage"
    r"|force|duty|input|manipulated|steering|brake"
)
"""Parts of names of control signals."""
_PART = re.compile(r"[A-Z]?[a-z]+\d*|[A-Z]+\d*")


def fmu_scenario(
    path: Path | str,
    *,
    knobs: Sequence[Knob] = (),
    show: Sequence[str] = (),
    reference: Mapping[str, float] | None = None,
    stop_time: float | None = None,
    title: str = "",
    brief: str = "",
    timeout: float = 60.0,
) -> Scenario:
    """Return the scenario of a closed loop in an FMU that includes its controller.

    A variable is shown as a control signal if the FMU declares it as an input or its name says so
    ("valve", "u", "voltage"), unless it has a reference; all others are outputs.

    The scenario counts as `simulated` if one simulation, of θ in the middle, takes at most 0.05 s:
    then many experiments are simulated unseen.

    Args:
        path: The .fmu file (FMI 2 or 3, co-simulation).
        knobs: Knobs named as the parameters of the FMU.
        show: Variables to show, with a unit if it is not the FMU's, as in "T [degC]"; by default
            the outputs of the FMU, the first eight.
        reference: Maps outputs, with a unit like those of `show`, to their reference in that unit;
            they are shown, too.
        stop_time: End of the simulation in seconds; None for that of the FMU.
        title: Title; by default the name of the model.
        brief: Task in a few sentences; by default the description of the model.
        timeout: Time limit of a run in seconds of real time.

    Raises:
        ScenarioError: If there is no knob (the message lists the parameters), or nothing to show.
            Other errors are those of `FMULoop`.
    """
    model = read_model(path)
    if not knobs:
        raise ScenarioError(_choice(model))
    outputs, inputs = _shown(model, show, reference or {})
    aims = {in_unit(name)[0]: value for name, value in (reference or {}).items()}
    given = (model.path, list(knobs), outputs, inputs, aims, stop_time)
    loop = FMULoop(*given, timeout=timeout)
    run: Any = partial(loop.attempt)  # which raises if there is no experiment, so that people are told why
    run.channels, run.signals = loop.channels, loop.signals
    return Scenario(
        name=re.sub(r"[^\w]+", "-", model.name).strip("-").lower() or "fmu",
        title=title or model.name,
        space=loop.space,
        run=run,
        brief=brief or model.about,
        # A worker runs θ, and never asks: without this, each would unpack the FMU once more.
        simulated=MARK not in os.environ and _is_quick(FMULoop(*given, timeout=min(timeout, _PROBED))),
    )


def described(d: Description, knobs: list[Knob], where: str) -> Scenario:
    """Return the scenario of a description; raises what `fmu_scenario` does."""
    return fmu_scenario(
        d.of,
        knobs=knobs,
        show=d.show,
        reference=d.reference or None,
        stop_time=d.stop_time,
        title=d.title,
        brief=d.brief,
        timeout=60.0 if d.timeout is None else d.timeout,
    )


def _choice(model: Model) -> str:
    """Return what to say if no knob is given: each parameter, with an option to copy."""
    if not model.parameters:
        return (
            f"FMU {model.path.name!r} has no tunable parameter: export it again with the "
            "parameters of its controller as tunable"
        )
    lines = [f"say which parameters of {model.path.name!r} are knobs, and their ranges, such as"]
    for v in model.parameters:
        start = "" if v.start is None else f"now {v.start:g} {v.unit}".rstrip()
        units = f"in {v.every_unit}" if v.units else ""
        note = ", ".join(part for part in (start, units, v.about) if part)
        lines.append(f'  --knob "{v.name}={_range(v)}"' + (f"  ({note})" if note else ""))
    return "\n".join(lines)


def _range(v: Variable) -> str:
    """Return a range around the start value: a decade to both sides, if there is no limit."""
    start = v.start or 0.0
    if v.whole:
        low, high = max(v.low, start - 5), min(v.high, start + 5)
        return f"{low:g}:{high:g}:int"
    if start > 0:
        low, high = max(v.low, start / 10), min(v.high, start * 10)
        return f"{low:g}:{high:g}:log" if low > 0 else f"{low:g}:{high:g}"
    span = 2 * abs(start) or 1.0
    return f"{max(v.low, -span):g}:{min(v.high, span):g}"


def _shown(model: Model, show: Sequence[str], reference: Mapping[str, float]) -> tuple[list[str], list[str]]:
    """Return the names of the outputs and of the control signals, with units if they have one."""
    named: dict[str, str] = {}
    for name in (*(show or [v.name for v in model.outputs[:_SHOWN]]), *reference):
        bare, unit = in_unit(name)
        if bare not in named or unit:
            named[bare] = name
    names, aims = list(named.values()), {in_unit(name)[0] for name in reference}
    if not names:
        raise ScenarioError(
            f"FMU {model.path.name!r} declares no outputs: say which variables to show, such as "
            f"--show {','.join(list(model.variables)[:2])}"
        )
    inputs = [n for n in names if in_unit(n)[0] not in aims and _is_input(model.variable(n))]
    if len(inputs) == len(names):
        return names, []
    return [n for n in names if n not in inputs], inputs


def _is_input(variable: Variable) -> bool:
    """Return whether causality or the last part of the name make it a control signal."""
    parts = _PART.findall(variable.name.rpartition(".")[2])
    named = any(_ACTUATORS.fullmatch(part.lower()) for part in parts)
    return variable.causality == "input" or named


def _is_quick(loop: FMULoop) -> bool:
    """Return whether θ in the middle of the space is simulated quickly, and without failing."""
    try:
        middle = loop.space.decode(np.full(len(loop.space), 0.5))
        done = len(loop(middle).t) > 0
    finally:
        loop.close()
    return done and loop.seconds is not None and loop.seconds <= _QUICK
