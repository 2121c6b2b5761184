"""What the model description of an FMU says: variables, units, limits, times."""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from prefcal_env.errors import PlantError
from prefcal_env.experiments.experiment import Channel
from prefcal_env.optional import world
from prefcal_env.wording import did_you_mean

from .units import AS_IT_IS, Scales, UnitScale, display_units, plain

_REALS = {"Real", "Float64", "Float32"}
_NUMBERS = {
    *_REALS,
    *("Integer", "Boolean", "Enumeration"),
    *(f"{sign}Int{bits}" for sign in ("", "U") for bits in (8, 16, 32, 64)),
}
"""Types of FMI 2 and 3 whose values are numbers."""
_LISTED = 12
"""Number of names that a message lists at most."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Variable(Channel):
    """A scalar variable of an FMU: a channel and what FMI says of it.

    Its name, unit and limits are those of the FMU; without a unit or a limit there, they are empty
    or infinite.

    Args:
        reference: Value reference.
        type: Type as in FMI, "Real" or "Float64" for example.
        causality: For example "parameter", "input", "output" or "local".
        variability: For example "tunable", "fixed" or "continuous".
        start: Start value, in `unit`; None if the FMU declares none.
        about: Description.
        units: Other units in which the FMU says that it can be given.
        scale: Conversion from the FMU's unit, if `unit` is another one.
    """

    reference: int
    type: str
    causality: str
    variability: str
    start: float | None = None
    about: str = ""
    units: Scales = field(default_factory=dict)
    scale: UnitScale = AS_IT_IS

    def __post_init__(self) -> None:
        """Accept any limits: an FMU may declare equal ones, and only what is shown must have a range."""

    def within(self, unit: str) -> "Variable | None":
        """Return the variable in a unit that the FMU defines for it; None if it defines none.

        Without a unit, here or in the FMU, the variable stays as it is.
        """
        if not plain(unit) or not plain(self.unit) or plain(unit) == plain(self.unit):
            return self
        scale = next((s for name, s in self.units.items() if plain(name) == plain(unit)), None)
        if scale is None:
            return None
        start = None if self.start is None else scale.shown(self.start)
        return replace(self.scaled(scale.factor, scale.offset), unit=unit, start=start, scale=scale)

    @property
    def every_unit(self) -> str:
        """Return all units in which it can be given, for messages."""
        return " or ".join(repr(unit) for unit in (self.unit or "none", *self.units))

    @property
    def limits(self) -> str:
        """Return its range with its unit, for messages."""
        return f"[{self.low:g}, {self.high:g}] {self.unit}".rstrip() + ", the limits of the FMU"

    @property
    def tunable(self) -> bool:
        """Whether it is a parameter that can be set before a run."""
        return self.causality == "parameter" and self.variability in ("tunable", "fixed")

    @property
    def whole(self) -> bool:
        """Whether its values are whole numbers (integers, enumerations and booleans)."""
        return self.type not in _REALS


@dataclass(frozen=True, slots=True)
class Model:
    """The model description of an FMU that can be simulated on this computer.

    Args:
        path: File.
        name: Name of the model.
        about: Description of the model.
        variables: Scalar numeric variables by name.
        start_time: Start of the default experiment, in seconds.
        stop_time: End of the default experiment, in seconds; None if the FMU declares none.
        step: Preferred time between two communications, in seconds; None if none is declared.
        tolerance: Relative tolerance of the FMU's solver; None if the FMU declares none.
        variable_step: Whether the time between two communications may vary.
    """

    path: Path
    name: str
    about: str
    variables: Mapping[str, Variable]
    start_time: float
    stop_time: float | None
    step: float | None
    tolerance: float | None
    variable_step: bool

    @property
    def parameters(self) -> tuple[Variable, ...]:
        """Variables that can be knobs."""
        return tuple(v for v in self.variables.values() if v.tunable)

    @property
    def outputs(self) -> tuple[Variable, ...]:
        """Variables that the FMU declares as outputs."""
        return tuple(v for v in self.variables.values() if v.causality == "output")

    def variable(self, name: str) -> Variable:
        """Return the variable called `name`, which may have a unit, as in "T [degC]".

        Raises:
            PlantError: If there is none, or the FMU does not define the unit; the message suggests
                a similar name.
        """
        if name in self.variables:
            return self.variables[name]
        bare, unit = in_unit(name)
        if bare in self.variables:
            found = self.variables[bare].within(unit)
            if found is None:
                units = self.variables[bare].every_unit
                raise PlantError(f"the unit of {bare!r} must be {units} as in the FMU, got {unit!r}")
            return found
        name = bare
        hint = did_you_mean(name, self.variables)
        there = hint or f" Its variables are {listed(self.variables)}"
        raise PlantError(f"FMU {self.path.name!r} has no numeric variable {name!r}.{there}")


def read_model(path: Path | str) -> Model:
    """Read the model description of an FMU (FMI 2 or 3, co-simulation); nothing runs.

    Args:
        path: The .fmu file.

    Raises:
        PlantError: If the file is missing, is no FMU, has another version or kind, or holds no
            binary for this computer.
        MissingExtraError: If the extra `fmu` is not installed.
    """
    path = Path(path).absolute()
    found = _description(path)
    experiment = found.defaultExperiment
    times = [
        _number(getattr(experiment, name, None))
        for name in ("startTime", "stopTime", "stepSize", "tolerance")
    ]
    step = times[2] or _number(found.coSimulation.fixedInternalStepSize)
    scalars = (v for v in found.modelVariables if v.type in _NUMBERS and not v.dimensions)
    units = display_units(path)
    return Model(
        path,
        name=found.modelName or path.stem,
        about=" ".join((found.description or "").split()),
        variables={v.name: _variable(v, units) for v in scalars},
        start_time=times[0] or 0.0,
        stop_time=times[1],
        step=step if step and step > 0 else None,
        tolerance=times[3],
        variable_step=bool(found.coSimulation.canHandleVariableCommunicationStepSize),
    )


def in_unit(name: str) -> tuple[str, str]:
    """Return name and unit of "T [degC]"; the unit is empty if there is none, as in "x[1]"."""
    found = re.fullmatch(r"(.*\S)\s+\[([^\[\]]*)\]", name)
    return (found[1], found[2]) if found else (name, "")


def listed(names: Iterable[str]) -> str:
    """Return names for a message, the first dozen of them."""
    all_ = list(names)
    more = f" and {len(all_) - _LISTED} more" if len(all_) > _LISTED else ""
    return (", ".join(repr(n) for n in all_[:_LISTED]) or "none") + more


def _description(path: Path) -> Any:
    """Return FMPy's model description of a file that can be simulated here."""
    if not path.is_file():
        raise PlantError(f"no FMU at {str(path)!r}: give the path of a .fmu file")
    fmpy = world("fmu").imported()
    try:
        found = fmpy.read_model_description(str(path), validate=False)
        platforms = fmpy.supported_platforms(str(path))
    except Exception as error:  # whatever FMPy, zipfile or lxml say about a file that is no FMU
        why = " ".join(str(error).split())
        raise PlantError(
            f"{path.name!r} is no FMU that can be read ({why}): export it again as FMI 2 or 3"
        ) from error
    if not str(found.fmiVersion).startswith(("2.", "3.")):
        raise PlantError(f"FMU {path.name!r} is of FMI {found.fmiVersion}: export it as FMI 2 or FMI 3")
    if found.coSimulation is None:
        raise PlantError(
            f"FMU {path.name!r} has no co-simulation interface: export it for co-simulation, so "
            "that it includes its solver"
        )
    if fmpy.platform not in platforms:
        raise PlantError(
            f"FMU {path.name!r} is built for {', '.join(platforms) or 'no platform'}, and this "
            f"computer needs {fmpy.platform}: export it with the binaries of {fmpy.platform}"
        )
    return found


def _variable(v: Any, units: Mapping[str, Scales]) -> Variable:
    """Return a variable as FMPy describes it.

    Args:
        v: Variable of FMPy's model description.
        units: Display units by unit.
    """
    declared = v.declaredType
    unit, low, high, relative = (
        getattr(v, name) if getattr(v, name) is not None else getattr(declared, name, None)
        for name in ("unit", "min", "max", "relativeQuantity")
    )
    others = dict(units.get(unit or "", {}))
    if relative in (True, "true", "1"):  # a difference of temperatures has no offset
        others = {name: UnitScale(scale.factor) for name, scale in others.items()}
    low, high = _number(low), _number(high)
    if v.type == "Boolean":
        low, high = 0.0, 1.0
    return Variable(
        v.name,
        reference=v.valueReference,
        type=v.type,
        causality=v.causality or "local",
        variability=v.variability or "continuous",
        unit=unit or "",
        low=-np.inf if low is None else low,
        high=np.inf if high is None else high,
        start=_number(v.start),
        about=" ".join((v.description or "").split()),
        units=others,
    )


def _number(text: object) -> float | None:
    """Return a number of the description; None if it is missing or no number."""
    if isinstance(text, str) and text.lower() in ("true", "false"):
        return float(text.lower() == "true")
    try:
        return None if text is None else float(text)  # type: ignore[arg-type]
    except ValueError:
        return None
