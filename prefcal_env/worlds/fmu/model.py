"""What the model description of an FMU says, and whether knobs, curves and times fit it."""

import re
import zipfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import ceil, floor, isfinite
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from jaxtyping import Float

from prefcal_env.arrays import is_number
from prefcal_env.errors import KnobError, PlantError
from prefcal_env.experiments.experiment import Channel
from prefcal_env.knobs import Knob
from prefcal_env.optional import world
from prefcal_env.units import AS_IT_IS, Conversion, conversion, plain, same
from prefcal_env.wording import did_you_mean

Scales = Mapping[str, Conversion]  # units by name, each with its conversion from the FMU's unit
_TRUE = ("true", "1")


def units_in(path: Path) -> tuple[Mapping[str, Scales], Mapping[str, bool]]:
    """Return the display units of each unit of an FMU, and whether variables say that they are differences.

    FMPy does not tell which display units of FMI 3 are inverse, which are left out, and overlooks what a
    variable itself says of a difference. What its type says is not returned here.
    """
    with zipfile.ZipFile(path) as content:
        root = ElementTree.fromstring(content.read("modelDescription.xml"))
    display = {
        unit.get("name", ""): {
            d.get("name", ""): Conversion(float(d.get("factor", 1)), float(d.get("offset", 0)))
            for d in unit.iterfind("DisplayUnit")
            if d.get("inverse", "false") not in _TRUE and float(d.get("factor", 1))
        }
        for unit in root.iterfind("UnitDefinitions/Unit")
    }
    relative = {
        variable.get("name", ""): part.get("relativeQuantity") in _TRUE
        for variable in root.iterfind("ModelVariables/*")
        for part in (variable, *variable)  # FMI 3 has the attribute here, FMI 2 in an element below
        if part.get("relativeQuantity") is not None
    }
    return display, relative


_MOST, _BLOCK = 2e9, 4096  # largest size of all files of an FMU in bytes, and what the smallest one takes
_HARMLESS, _RATIO = 50e6, 100  # size in bytes above which it may be so many times that of the FMU


def refuse_bomb(content: zipfile.ZipFile, path: Path) -> None:
    """Refuse an FMU that would fill the disk.

    `zipfile` never unpacks more of a file than the sizes that are added here say.

    Raises:
        PlantError: If its files are too large together, or compressed as only empty ones can be.
    """
    size, packed = sum(max(file.file_size, _BLOCK) for file in content.infolist()), path.stat().st_size
    if size > min(_MOST, max(_HARMLESS, _RATIO * packed)):
        raise PlantError(
            f"FMU {path.name!r} is not unpacked: its {packed / 1e6:.3g} MB would become {size / 1e9:.3g} GB; "
            f"at most {_MOST / 1e9:g} GB, and above {_HARMLESS / 1e6:g} MB at most {_RATIO} times its size, "
            "are expected. Export it again without large files"
        )


# --- What the model description of an FMU says: variables, units, limits, times.

_REALS = {"Real", "Float64", "Float32"}
_NUMBERS = {
    *_REALS,
    *("Integer", "Boolean", "Enumeration"),
    *(f"{sign}Int{bits}" for sign in ("", "U") for bits in (8, 16, 32, 64)),
}
"""Types of FMI 2 and 3 whose values are numbers."""
_LISTED = 12  # number of names that a message lists at most


@dataclass(frozen=True, slots=True, kw_only=True)
class Variable(Channel):
    """A scalar variable of an FMU: a channel and what FMI says of it.

    Its name, unit and limits are those of the FMU; without a unit or a limit there, they are empty
    or infinite.
    """

    reference: int  # value reference
    type: str  # as in FMI, "Real" or "Float64" for example
    causality: str  # for example "parameter", "input", "output" or "local"
    variability: str  # for example "tunable", "fixed" or "continuous"
    start: float | None = None  # start value, in `unit`; None if the FMU declares none
    about: str = ""  # description
    units: Scales = field(default_factory=dict)  # others in which the FMU says that it can be given
    difference: bool = False  # whether it is a difference, which has no offset in another unit
    scale: Conversion = AS_IT_IS  # conversion from the FMU's unit, if `unit` is another one

    def __post_init__(self) -> None:
        """Accept any limits: an FMU may declare equal ones, and only what is shown must have a range."""

    def within(self, unit: str) -> "Variable | None":
        """Return the variable in another unit, as the FMU defines it or as is usual; None if it cannot be.

        Without a unit, here or in the FMU, the variable stays as it is. That of a gain is often 1.
        """
        if not unit or not self.unit or same(unit, self.unit):
            return self
        scale = next((s for name, s in self.units.items() if same(name, unit)), None)
        scale = scale or conversion(self.unit, unit, difference=self.difference)
        if scale is None:
            return self if "1" in (plain(unit), plain(self.unit)) else None
        start = None if self.start is None else scale.to(self.start)
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
    """The model description of an FMU that can be simulated on this computer; times are in seconds."""

    path: Path
    name: str
    about: str
    variables: Mapping[str, Variable]  # scalar numeric ones, by name
    start_time: float  # of the default experiment
    stop_time: float | None  # likewise; None if the FMU declares none
    step: float | None  # preferred time between two communications; None if none is declared
    tolerance: float | None  # relative one of the FMU's solver; None if the FMU declares none
    variable_step: bool  # whether the time between two communications may vary

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
        if bare not in self.variables:
            there = did_you_mean(bare, self.variables) or f" Its variables are {listed(self.variables)}"
            raise PlantError(f"FMU {self.path.name!r} has no numeric variable {bare!r}.{there}")
        found = self.variables[bare].within(unit)
        if found is None:
            units = self.variables[bare].every_unit
            raise PlantError(f"the unit of {bare!r} must be {units} as in the FMU, or alike, got {unit!r}")
        return found


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
    names = ("startTime", "stopTime", "stepSize", "tolerance")
    start, stop, step, tolerance = (_number(getattr(experiment, name, None)) for name in names)
    step = step or _number(found.coSimulation.fixedInternalStepSize)
    scalars = (v for v in found.modelVariables if v.type in _NUMBERS and not v.dimensions)
    units, relative = units_in(path)
    return Model(
        path,
        name=found.modelName or path.stem,
        about=" ".join((found.description or "").split()),
        variables={v.name: _variable(v, units, relative.get(v.name)) for v in scalars},
        start_time=start or 0.0,
        stop_time=stop,
        step=step if step and step > 0 else None,
        tolerance=tolerance,
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
        with zipfile.ZipFile(path) as content:
            refuse_bomb(content, path)
        found = fmpy.read_model_description(str(path), validate=False)
        platforms = fmpy.supported_platforms(str(path))
    except PlantError:
        raise
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


def _variable(v: Any, units: Mapping[str, Scales], relative: bool | None) -> Variable:
    """Return a variable as FMPy describes it, with the display units of its unit.

    `relative` is whether it says that it is a difference; None if it leaves that to its type.
    """
    declared = v.declaredType
    unit, low, high = (
        getattr(v, name) if getattr(v, name) is not None else getattr(declared, name, None)
        for name in ("unit", "min", "max")
    )
    others = dict(units.get(unit or "", {}))
    difference = bool(getattr(declared, "relativeQuantity", False)) if relative is None else relative
    if difference:  # of temperatures has no offset
        others = {name: Conversion(scale.factor) for name, scale in others.items()}
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
        difference=difference,
    )


def _number(text: object) -> float | None:
    """Return a number of the description; None if it is missing or no number."""
    if isinstance(text, str) and text.lower() in ("true", "false"):
        return float(text.lower() == "true")
    try:
        return None if text is None else float(text)  # type: ignore[arg-type]
    except ValueError:
        return None


# --- Check knobs, curves and times of a loop against its FMU, before anything runs.

_ROUNDING = 1e-9  # relative error of a ratio of times that counts as a whole number

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
            f"knob {knob.name!r}: its unit must be {variable.every_unit} as in the FMU, or alike, got "
            f"{knob.unit!r}"
        )
    if knob.low < given.low or knob.high > given.high:
        range_ = f"[{knob.low:g}, {knob.high:g}]"
        raise KnobError(f"knob {knob.name!r}: its range must lie in {given.limits}, got {range_}")
    if given.whole and not knob.integer:
        raise KnobError(f"knob {knob.name!r}: the FMU's type is {given.type}, so it needs integer=True")
    stated = plain(knob.unit) not in ("", "1") or given.scale != AS_IT_IS
    unit = knob.unit if stated else given.unit
    unit = "" if plain(unit) == "1" and given.scale == AS_IT_IS else unit
    return replace(knob, unit=unit, about=knob.about or variable.about)


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
            variable, unit = model.variable(value), outputs[name].unit
            found = variable.within(unit)
            if found is None:
                raise PlantError(
                    f"reference {variable.name!r} is in {variable.unit}, and {name!r} in {unit}: "
                    "show the output in the unit of its reference, or name another variable"
                )
            variables[name] = found
        elif is_number(value) and isfinite(value):
            numbers[name] = float(value)
        else:
            raise PlantError(
                f"reference of {name!r} must be a finite number or the name of a variable of the "
                f"FMU, got {value!r}"
            )
    return numbers, variables


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
        return (interval or length / 500), 1
    step = min(model.step, length)
    if interval is None:
        return step, ceil(length / step / 2_000 - _ROUNDING)  # at most so many are recorded unasked
    ratio = interval / step
    every = round(ratio)
    if every >= 1 and abs(ratio - every) <= _ROUNDING * ratio:
        return step, every
    return interval / ceil(ratio), ceil(ratio)
