"""Make a live rig from plain data, such as the table [opcua] of a TOML file."""

import os
from collections.abc import Callable, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any, Literal

import msgspec

from prefcal_env.errors import SettingsError
from prefcal_env.knobs import Knob
from prefcal_env.plain import checked, entries

from .opcua import OPCUAPlant
from .plan import Journal, LiveKnob, LivePlant, LiveStart, Role, Tag
from .rig import LiveRig

Range = tuple[float, float]
Entries = dict[str, dict[str, Any]]


class LiveTable(msgspec.Struct, frozen=True, kw_only=True):
    """Keys of a live rig as plain data; those left out have the defaults of what they are for."""

    url: str
    duration: float
    knobs: Entries
    outputs: Entries
    inputs: Entries = {}
    references: Entries = {}
    start: Entries = {}
    ready: dict[str, Range] = {}
    done: dict[str, Range] = {}
    period: float | None = None
    ready_within: float | None = None
    hold: float | None = None
    blind: float | None = None
    after: Literal["restore", "keep"] | None = None
    journal: str | None = None
    instructions: str | None = None
    user: str | None = None
    password_variable: str | None = None
    security: str | None = None
    timeout: float | None = None


def live_rig(description: Mapping[str, Any], *, plant: Callable[[str], LivePlant] | None = None) -> LiveRig:
    """Return the live rig that plain data describes.

    Args:
        description: "url", "duration" and the tables "knobs" (node, low, high, rate) and "outputs"
            (node) are required. Tables "inputs", "references" and "start", the conditions "ready"
            and "done", and the other arguments of `LiveRig` are optional.
        plant: Function that connects to an address; by default, over OPC UA.

    Raises:
        SettingsError: If a name is unknown, missing or of the wrong type; the message says where.
        KnobError: If a knob, or the range of a start value, is not valid.
        LiveError: If the address is none of OPC UA.
        MissingExtraError: If asyncua is not installed.
    """
    given = entries(description, (LiveTable,), "", SettingsError)
    as_they_are = {field.name for field in fields(LiveRig)} - {"knobs", "start", "journal"}
    roles: tuple[tuple[Role, Entries], ...] = (
        ("output", given["outputs"]),
        ("input", given.get("inputs", {})),
        ("reference", given.get("references", {})),
    )
    return LiveRig(
        plant=_connection(given) if plant is None else plant(given["url"]),
        knobs=tuple(_knob(name, entry, f"knobs.{name}") for name, entry in given["knobs"].items()),
        tags=tuple(
            checked(entry, Tag, f"{role}s.{name}", SettingsError, name=name, role=role)
            for role, tags in roles
            for name, entry in tags.items()
        ),
        start=tuple(_start(name, entry, f"start.{name}") for name, entry in given.get("start", {}).items()),
        journal=_journal(given["journal"]) if "journal" in given else None,
        **{name: value for name, value in given.items() if name in as_they_are},
    )


def _knob(name: str, entry: dict[str, Any], where: str) -> LiveKnob:
    plain = entry | {"scale": "log10"} if entry.get("scale") == "log" else entry
    found = entries(plain, (LiveKnob, Knob), where, SettingsError, known=("name", "knob"))
    node, rate = found.pop("node"), found.pop("rate")
    return LiveKnob(Knob(name, **found), node, rate)


def _start(name: str, entry: dict[str, Any], where: str) -> LiveStart:
    tuned_only = ("scale", "step", "about")
    found = entries(entry, (LiveStart, Knob), where, SettingsError, known=("name", "knob", *tuned_only))
    node, rate, value = (found.pop(key) for key in ("node", "rate", "value"))
    return LiveStart(Knob(name, **found), node, rate, value=value)


def _connection(given: Mapping[str, Any]) -> OPCUAPlant:
    stated = {name: given[name] for name in ("user", "security", "timeout") if name in given}
    variable = given.get("password_variable")
    if variable:
        if variable not in os.environ:
            raise SettingsError(f"the environment variable {variable!r} must hold the password")
        stated["password"] = os.environ[variable]
    return OPCUAPlant(given["url"], **stated)


def _journal(path: str) -> Journal:
    if Path(path).name in ("", ".."):
        raise SettingsError(f'journal: expected a file such as "old.json", got {path!r}')
    return Journal(Path(path).expanduser())
