"""Make a live rig from plain data, such as the table [opcua] of a TOML file."""

import os
from collections.abc import Callable, Mapping
from math import inf
from pathlib import Path
from typing import Any

from prefcal_env.errors import SettingsError
from prefcal_env.knobs.knob import Knob

from .journal import Journal
from .opcua import OPCUAPlant
from .parts import LiveKnob, LiveStart, Tag
from .plant import LivePlant
from .rig import LiveRig

_CONNECTION = ("user", "password_variable", "security", "timeout")
_PLAIN = ("duration", "period", "ready_within", "hold", "blind", "after", "instructions")
_TABLES = {
    "knobs": ("node", "low", "high", "rate", "unit", "scale", "integer", "step", "about"),
    "outputs": ("node", "unit", "low", "high", "abort"),
    "inputs": ("node", "unit", "low", "high", "abort"),
    "references": ("node", "unit"),
    "start": ("node", "value", "low", "high", "rate", "unit", "integer"),
}
"""Fields of the entries of each table, which are named by their knob or signal."""


def live_rig(
    description: Mapping[str, Any], *, plant: Callable[[str], LivePlant] | None = None
) -> LiveRig:
    """Return the live rig that plain data describes.

    Args:
        description: "url", "duration" and the tables "knobs" (node, low, high, rate) and "outputs"
            (node) are required. Tables "inputs", "references" and "start", the conditions "ready"
            and "done", and the other arguments of `LiveRig` are optional.
        plant: Function that connects to an address; by default, over OPC UA.

    Raises:
        SettingsError: If a name is unknown, missing or of the wrong type; the message says where.
        KnobError: If a knob is not valid.
        MissingExtraError: If asyncua is not installed.
    """
    known = ("url", "journal", "ready", "done", *_CONNECTION, *_PLAIN, *_TABLES)
    _check(description, known, ("url", "duration", "knobs", "outputs"), "the live rig")
    for name, fields in _TABLES.items():
        for key, entry in _table(description, name).items():
            _check(entry, fields, ("node",), f"{name}.{key}")
    plain = {name: description[name] for name in _PLAIN if name in description}
    if "journal" in description:
        plain["journal"] = Journal(Path(description["journal"]).expanduser())
    for name in ("ready", "done"):
        limits = _table(description, name)
        plain[name] = {key: _pair(value, f"{name}.{key}") for key, value in limits.items()}
    return LiveRig(
        plant=_connection(description) if plant is None else plant(description["url"]),
        knobs=tuple(_knob(name, e) for name, e in _table(description, "knobs").items()),
        tags=tuple(
            _tag(name, e, role)
            for role in ("output", "input", "reference")
            for name, e in _table(description, f"{role}s").items()
        ),
        start=tuple(_start(name, e) for name, e in _table(description, "start").items()),
        **plain,
    )


def _connection(description: Mapping[str, Any]) -> OPCUAPlant:
    given = {k: description[k] for k in ("user", "security", "timeout") if k in description}
    variable = description.get("password_variable", "")
    if variable:
        if variable not in os.environ:
            raise SettingsError(f"the environment variable {variable!r} must hold the password")
        given["password"] = os.environ[variable]
    return OPCUAPlant(str(description["url"]), **given)


def _knob(name: str, entry: Mapping[str, Any]) -> LiveKnob:
    where = f"knobs.{name}"
    rest = {k: entry[k] for k in ("unit", "scale", "integer", "step", "about") if k in entry}
    knob = Knob(name, _real(entry, "low", where), _real(entry, "high", where), **rest)
    return LiveKnob(knob, str(entry["node"]), _real(entry, "rate", where))


def _start(name: str, entry: Mapping[str, Any]) -> LiveStart:
    value, low, high, rate = (
        _real(entry, field, f"start.{name}") for field in ("value", "low", "high", "rate")
    )
    unit, integer = str(entry.get("unit", "")), bool(entry.get("integer", False))
    return LiveStart(name, str(entry["node"]), value, low, high, rate, unit, integer)


def _tag(name: str, entry: Mapping[str, Any], role: Any) -> Tag:
    where = f"{role}s.{name}"
    low, high = _real(entry, "low", where, -inf), _real(entry, "high", where, inf)
    abort = _pair(entry["abort"], f"{where}.abort") if "abort" in entry else (-inf, inf)
    return Tag(name, str(entry["node"]), role, str(entry.get("unit", "")), low, high, abort)


def _check(
    entry: object, known: tuple[str, ...], required: tuple[str, ...], where: str
) -> None:  # fmt: skip
    if not isinstance(entry, Mapping):
        raise SettingsError(f"{where} must be a table with {', '.join(known)}, got {entry!r}")
    strangers = sorted(set(entry) - set(known))
    if strangers:
        raise SettingsError(f"{where} takes {', '.join(known)}, got {strangers[0]!r}")
    missing = [name for name in required if name not in entry]
    if missing:
        raise SettingsError(f"{where} needs {missing[0]!r}")


def _table(description: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    table = description.get(name, {})
    if not isinstance(table, Mapping):
        raise SettingsError(f"{name} must be a table by name, got {table!r}")
    return table


def _real(entry: Mapping[str, Any], field: str, where: str, default: float | None = None) -> float:
    value = entry.get(field, default)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise SettingsError(f"{where} needs a number {field!r}, got {value!r}")
    return float(value)


def _pair(value: object, where: str) -> tuple[float, float]:
    if (
        not isinstance(value, list | tuple)
        or len(value) != 2
        or any(isinstance(v, bool) or not isinstance(v, int | float) for v in value)
    ):
        raise SettingsError(f"{where} must be two numbers [low, high], got {value!r}")
    return float(value[0]), float(value[1])
