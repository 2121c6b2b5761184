"""Optional worlds, which `optional.toml` declares, and what other distributions add to prefcal."""

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from types import ModuleType
from typing import Any

from .errors import MissingExtraError, SettingsError
from .wording import did_you_mean

# --- Find what other distributions add to prefcal: agents, people who answer, scenarios and commands.
#
# They are listed as entry points of installed distributions. Looking for them takes some 20 ms, so this
# happens only when something unknown is asked for.

BENCHMARK = "pip install prefcal-bench (in a clone: pip install ./benchmarks)"
"""How to install the benchmark, which has most of what is missing without it."""


@cache
def load_extensions() -> None:
    """Import the modules of the group `prefcal.extensions`, which register what they add; once."""
    for found in entry_points(group="prefcal.extensions"):
        found.load()


def command(name: str) -> EntryPoint | None:
    """Return the command called `name` of the group `prefcal.commands`; None if there is none."""
    return next(iter(entry_points(group="prefcal.commands", name=name)), None)


# --- The optional worlds: what prefcal can do with other software, each in a module of its own.
#
# `optional.toml` declares them. Others ask here, and import a world when it is used.


@dataclass(frozen=True, slots=True, kw_only=True)
class World:
    """One optional world; `optional.toml` says what its fields mean."""

    name: str
    about: str
    library: str
    extra: str
    missing: str = ""
    key: str = ""
    type: str = "text"
    paths: Sequence[str] = ()
    example: str = ""
    ending: str = ""
    file: str = ""
    called: str = ""
    starter: str = ""
    system: str = ""
    equations: bool = False
    unit: Mapping[str, str] = field(default_factory=dict)
    usage: Mapping[str, Sequence[str]] = field(default_factory=dict)

    def inside(self, package: str) -> ModuleType:
        """Return the world's module in a package of prefcal, imported now."""
        return import_module(f"{package}.worlds.{self.name}")

    def imported(self) -> Any:
        """Return the library of the world, imported now.

        Raises:
            MissingExtraError: If it is not installed; the message says what to install.
        """
        try:
            return import_module(self.library)
        except ImportError as error:
            needs = self.missing or f"{self.about} needs the package {self.library}"
            raise MissingExtraError(f"{needs}: pip install 'prefcal[{self.extra}]'") from error


_TABLE = Path(__file__).with_name("optional.toml").read_text(encoding="utf-8")
WORLDS = tuple(World(**row) for row in tomllib.loads(_TABLE).get("world", ()))
ENDINGS = tuple(world.ending for world in WORLDS if world.ending)
"""Endings of the files that are a scenario by themselves."""


def world(name: str) -> World:
    """Return the world called `name`.

    Raises:
        SettingsError: If there is none.
    """
    there = {each.name: each for each in WORLDS}
    if name not in there:
        raise SettingsError(
            f"no optional world is called {name!r}.{did_you_mean(name, there)} Expected {', '.join(there)}"
        )
    return there[name]


def world_of(thing: object) -> World | None:
    """Return the world whose library, or whose module of ours, has the class of `thing`; None if none."""
    for kind in type(thing).__mro__:
        package, *inside = kind.__module__.split(".")
        for each in WORLDS:
            if package == each.library or inside[:2] == ["worlds", each.name]:
                return each
    return None
