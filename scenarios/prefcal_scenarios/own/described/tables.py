"""The tables and keys of a described scenario, and how they are checked."""

import re
from collections.abc import Mapping
from typing import Any, Literal, TypeVar

import msgspec

from prefcal_env.errors import ScenarioError
from prefcal_env.wording import did_you_mean

Table = TypeVar("Table", bound=msgspec.Struct)
Signals = dict[str, dict[str, Any]]


class KnobTable(msgspec.Struct, frozen=True):
    """One knob: see `prefcal_env.Knob`; scale "log" is short for "log10"."""

    low: float
    high: float
    unit: str = ""
    scale: Literal["linear", "log", "log10"] = "linear"
    integer: bool = False
    step: float | None = None
    about: str = ""


class KPITable(msgspec.Struct, frozen=True):
    """What a file says about one KPI: see `prefcal_scenarios.KPI`."""

    at_most: float | None = None
    at_least: float | None = None
    better: Literal["lower", "higher"] | None = None
    title: str | None = None
    unit: str | None = None
    about: str | None = None


class PanelTable(msgspec.Struct, frozen=True):
    """What a file says about one panel: see `prefcal_scenarios.Panel`."""

    title: str = ""
    unit: str | None = None
    scale: float = 1.0
    low: float | None = None
    high: float | None = None
    target: float | None = None
    band: float | None = None


class SignalTable(msgspec.Struct, frozen=True):
    """One recorded column of a rig."""

    unit: str = ""
    low: float | None = None
    high: float | None = None
    band: float | None = None
    sensor: tuple[float, float] | None = None


class RigTable(msgspec.Struct, frozen=True):
    """A plant that only a person can run."""

    outputs: Signals
    inputs: Signals = {}
    instructions: str = ""
    time_unit: str = "s"
    max_gap: float | None = None
    max_rows: int | None = None


class Description(msgspec.Struct, frozen=True, kw_only=True):
    """A scenario as plain data.

    Exactly one of `fmu`, `controller`, `rig` and `opcua` says what is calibrated.
    """

    name: str = ""
    title: str = ""
    brief: str = ""
    simulated: bool | None = None
    fmu: str | None = None
    controller: str | None = None
    plant: str | dict[str, Any] | None = None
    rig: dict[str, Any] | None = None
    opcua: dict[str, Any] | None = None
    knobs: dict[str, str | dict[str, Any]] = {}
    show: list[str] = []
    reference: dict[str, float] = {}
    stop_time: float | None = None
    kpis: dict[str, float | dict[str, Any]] | Literal["none"] | None = None
    panels: dict[str, dict[str, Any]] = {}
    starts: dict[str, dict[str, float]] = {}


def checked(values: Mapping[str, Any], table: type[Table], where: str) -> Table:
    """Return `values` as a `table`.

    Args:
        values: Plain data by key.
        table: Keys that are known, and their types.
        where: Place in the file, for messages.

    Raises:
        ScenarioError: If a key is unknown or missing, or a value has the wrong type.
    """
    fields = {field.name: field for field in msgspec.structs.fields(table)}
    for key in values:
        if key not in fields:
            raise ScenarioError(
                f"{where}: there is no key {key!r}.{did_you_mean(key, fields)} "
                f"Expected {', '.join(fields)}"
            )
    found = {k: _value(v, fields[k].type, f"{where}: {k}") for k, v in values.items()}
    missing = [name for name, field in fields.items() if field.required and name not in found]
    if missing:
        raise ScenarioError(f"{where}: {missing[0]!r} is missing, expected {_example(missing[0])}")
    return table(**found)


def _value(value: Any, type_: Any, where: str) -> Any:
    try:
        return msgspec.convert(value, type_)
    except msgspec.ValidationError as error:
        problem, _, place = str(error).partition(" - at `$")
        if place.startswith("[...]") and isinstance(value, dict) and len(value) > 1:
            for key, entry in value.items():  # msgspec does not tell which entry is wrong
                _value({key: entry}, type_, where)
        if place.startswith("[...]") and isinstance(value, dict) and value:
            key, value = next(iter(value.items()))
            where = f"{where}, {key}"
        wanted = re.sub(r"`([^`]*)`", lambda m: _in_words(m[1]), problem.split(", got")[0])
        wanted = wanted[:1].lower() + wanted[1:]
        if wanted.startswith("invalid enum value"):
            options = ", ".join(repr(option) for option in _options(type_))
            wanted = f"expected one of {options}"
        raise ScenarioError(f"{where}: {wanted}, got {value!r:.80}") from error


_WORDS = {
    "float": "a number", "int": "a whole number", "str": "a text", "bool": "true or false",
    "array": "a list", "object": "a table",
}  # fmt: skip


def _in_words(names: str) -> str:
    words = [_WORDS.get(name, name) for name in names.split(" | ") if name != "null"]
    return " or ".join(dict.fromkeys(words))


def _options(type_: Any) -> list[str]:
    """Return the texts that a type allows."""
    options = getattr(type_, "__args__", ())
    found = [o for o in options if isinstance(o, str)]
    return found + [word for option in options for word in _options(option)]


def _example(key: str) -> str:
    return {
        "low": "low = 0.1", "high": "high = 100.0",
        "outputs": 'a table [rig.outputs] with level = { unit = "m" }',
    }.get(key, f"{key} = ...")  # fmt: skip
