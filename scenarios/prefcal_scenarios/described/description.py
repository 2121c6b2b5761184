"""Describe a scenario as plain data: in a TOML file, by options, or by both."""

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import msgspec

from prefcal_env.described import Keys, entries
from prefcal_env.errors import ScenarioError
from prefcal_env.optional import WORLDS, World
from prefcal_env.wording import did_you_mean
from prefcal_scenarios.names import CONTROLLERS, either

_MERGED = ("knobs", "reference", "kpis", "panels", "starts")
"""Tables to which options add entries; they replace any other value of a file."""
_WORLDS = {world.key: world for world in WORLDS if world.key}
_TYPES: Mapping[str, Any] = {"text": str | None, "table": dict[str, Any] | None}
_KEYS: Keys = {key: (_TYPES[world.type], False) for key, world in _WORLDS.items()}
"""Keys of optional worlds, which a description may have instead of `controller` and `rig`."""
_CONTROLLER = "controller = " + either(f'"{word}"' for word in CONTROLLERS)
"""What names a standard controller, for messages."""


class Description(msgspec.Struct, frozen=True, kw_only=True):
    """A scenario as plain data.

    Exactly one of `controller`, `rig` and the key of an optional world says what is calibrated.
    `world` is that world, and `of` the value of its key.
    """

    name: str = ""
    title: str = ""
    brief: str = ""
    simulated: bool | None = None
    controller: str | None = None
    plant: str | dict[str, Any] | None = None
    rig: dict[str, Any] | None = None
    world: World | None = None
    of: Any = None
    knobs: dict[str, str | dict[str, Any]] = {}
    show: list[str] = []
    reference: dict[str, float] = {}
    stop_time: float | None = None
    timeout: float | None = None
    kpis: dict[str, float | str | dict[str, Any]] | Literal["none"] | None = None
    panels: dict[str, dict[str, Any]] = {}
    starts: dict[str, dict[str, float]] = {}


def description_of(name: str, config: Mapping[str, Any]) -> Description:
    """Return the description of the scenario called `name`, with paths as seen from here.

    Args:
        name: Path of a TOML file or of a file of an optional world, or the name of a standard
            controller.
        config: Keys that are added to the file's, or replace them.

    Raises:
        ScenarioError: If the file cannot be read, or a key is unknown or has the wrong type.
    """
    path = Path(name)
    values: dict[str, Any] = {}
    if path.suffix == ".toml":
        values = _with_paths(_read(path), path.parent)
    else:
        key = next((world.key for world in WORLDS if world.ending == path.suffix != ""), "controller")
        values = {key: name}
    for key, value in config.items():
        both = key in _MERGED and isinstance(value, Mapping)
        merges = both and isinstance(values.get(key), Mapping)
        values[key] = {**values[key], **value} if merges else value
    found = stated(values, name, _KEYS, Description, known=("world", "of"))
    _check_subject(found, name)
    there = next((key for key in _KEYS if found.get(key) is not None), "")
    of = {key: found.pop(key, None) for key in _KEYS}.get(there)
    return Description(**found, world=_WORLDS.get(there), of=of)


def _read(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_bytes().decode("utf-8-sig"))
    except (OSError, UnicodeDecodeError) as error:
        said = getattr(error, "strerror", None) or error
        raise ScenarioError(f"cannot read the scenario {str(path)!r}: {said}") from error
    except tomllib.TOMLDecodeError as error:
        raise ScenarioError(
            f"{str(path)!r} is not TOML: {error}. A text needs quotation marks, and a name with a "
            'space, too: "set point" = 2.0'
        ) from error


def _with_paths(values: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Return `values` with the paths that a file in `folder` states, as seen from here."""
    for key in (*(key for key, world in _WORLDS.items() if world.ending), "plant"):
        if isinstance(values.get(key), str):
            values[key] = str(folder / values[key])
    for key, world in _WORLDS.items():
        for name in world.paths:
            table = values.get(key)
            if isinstance(table, dict) and isinstance(table.get(name), str) and table[name]:
                values[key] = {**table, name: str(folder / Path(table[name]).expanduser())}
    return values


def _check_subject(found: Mapping[str, Any], where: str) -> None:
    there = [key for key in (*_KEYS, "controller", "rig") if found.get(key) is not None]
    if len(there) != 1:
        got = " and ".join(there) or "none"
        ways = [*(world.example for world in _WORLDS.values()), _CONTROLLER]
        raise ScenarioError(f"{where}: expected one of {', '.join(ways)} and [rig], got {got}")
    if found.get("plant") is not None and found.get("controller") is None:
        raise ScenarioError(f"{where}: a plant needs {_CONTROLLER} to be calibrated, or leave it out")


def stated(
    values: Mapping[str, Any],
    where: str,
    *tables: type | Keys,
    known: tuple[str, ...] = ("name",),
    partial: bool = True,
) -> dict[str, Any]:
    """Return what a table of a file states, each value in the type of its key.

    Args:
        values: Plain data by key.
        where: Place in the file, for messages.
        tables: Classes whose fields are the keys, or the keys themselves.
        known: Fields that are no keys.
        partial: Whether required keys may be left out.

    Raises:
        ScenarioError: If a key is unknown or missing, or a value has the wrong type.
    """
    return entries(values, tables, where, ScenarioError, did_you_mean, known=known, partial=partial)
