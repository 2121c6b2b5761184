"""Make a live rig from plain data, such as the table [opcua] of a TOML file."""

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from msgspec.structs import asdict

from prefcal_env.described import Table, checked
from prefcal_env.errors import SettingsError
from prefcal_env.knobs.knob import Knob, Scale

from .journal import Journal
from .opcua import OPCUAPlant
from .parts import LiveKnob, LiveStart, Role, Tag
from .plant import LivePlant
from .rig import LiveRig
from .tables import Entries, KnobTable, LiveTable, ReferenceTable, StartTable, TagTable

_CONNECTION = ("user", "security", "timeout")
_PLAIN = ("duration", "period", "ready_within", "hold", "blind", "after", "instructions")


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
        LiveError: If the address is none of OPC UA.
        MissingExtraError: If asyncua is not installed.
    """
    given = checked(description, LiveTable, "", SettingsError)
    knobs = tuple(_knob(n, t) for n, t in _entries(given.knobs, "knobs", KnobTable))
    roles: tuple[tuple[Role, Entries, Any], ...] = (
        ("output", given.outputs, TagTable),
        ("input", given.inputs, TagTable),
        ("reference", given.references, ReferenceTable),
    )
    tags = tuple(
        Tag(name, role=role, **asdict(t))
        for role, entries, table in roles
        for name, t in _entries(entries, f"{role}s", table)
    )
    starts = tuple(
        LiveStart(name, **asdict(t)) for name, t in _entries(given.start, "start", StartTable)
    )
    return LiveRig(
        plant=_connection(given) if plant is None else plant(given.url),
        knobs=knobs, tags=tags, start=starts, ready=given.ready, done=given.done,
        journal=None if given.journal is None else _journal(given.journal),
        **_stated(given, _PLAIN),
    )  # fmt: skip


def _entries(entries: Entries, name: str, table: type[Table]) -> list[tuple[str, Table]]:
    return [
        (key, checked(entry, table, f"{name}.{key}", SettingsError))
        for key, entry in entries.items()
    ]


def _stated(given: LiveTable, names: tuple[str, ...]) -> dict[str, Any]:
    return {name: v for name in names if (v := getattr(given, name)) is not None}


def _connection(given: LiveTable) -> OPCUAPlant:
    stated, variable = _stated(given, _CONNECTION), given.password_variable
    if variable:
        if variable not in os.environ:
            raise SettingsError(f"the environment variable {variable!r} must hold the password")
        stated["password"] = os.environ[variable]
    return OPCUAPlant(given.url, **stated)


def _journal(path: str) -> Journal:
    if Path(path).name in ("", ".."):
        raise SettingsError(f'journal: expected a file such as "old.json", got {path!r}')
    return Journal(Path(path).expanduser())


def _knob(name: str, t: KnobTable) -> LiveKnob:
    scale: Scale = "log10" if t.scale == "log" else t.scale
    knob = Knob(name, t.low, t.high, t.unit, scale, t.integer, t.step, about=t.about)
    return LiveKnob(knob, t.node, t.rate)
