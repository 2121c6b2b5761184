"""One agent of the benchmark: how it is made, what it is told, and what it needs installed."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from importlib.metadata import PackageNotFoundError
from importlib.metadata import version as installed
from importlib.util import find_spec
from typing import Any, Literal

from prefcal_env.errors import MissingExtraError
from prefcal_env.knobs import KnobSpace

Kind = Literal["preference", "value"]
Make = Callable[[KnobSpace, int, int, int], Any]


@dataclass(frozen=True)
class Entry:
    """An agent by name; nothing is imported before it is made.

    Args:
        name: In tables and on the command line.
        kind: Whether it is told preferences, or the value of each experiment.
        build: Makes it from space, n_init, n_max and seed.
        algorithm: Gives the version of its algorithm, settings included.
        needs: Modules that have to be installed.
        extra: What brings them: `pip install prefcal[extra]`.
    """

    name: str
    kind: Kind
    build: Make
    algorithm: Callable[[], str]
    needs: tuple[str, ...] = ()
    extra: str = ""

    def make(self, space: KnobSpace, n_init: int, n_max: int, seed: int) -> Any:
        """Return the agent, which has `ask`, `tell`, `done` and `best`.

        Raises:
            MissingExtraError: something is not installed.
            SettingsError: an impossible value.
        """
        if self.missing:
            raise MissingExtraError(self.missing)
        return self.build(space, n_init, n_max, seed)

    @property
    def missing(self) -> str:
        """What is not installed, in words; empty if nothing is missing."""
        absent = [name for name in self.needs if not is_installed(name)]
        if not absent:
            return ""
        return f"{self.name} needs {', '.join(absent)}: pip install 'prefcal[{self.extra}]'"

    @cached_property
    def version(self) -> str:
        """Of the algorithm: with another one, results are computed anew."""
        return "" if self.missing else self.algorithm()


def is_installed(module: str) -> bool:
    """Whether `module` could be imported; its parents are, it is not."""
    try:
        return find_spec(module) is not None
    except ModuleNotFoundError:
        return False


def package_version(name: str) -> str:
    """Version of an installed package."""
    try:
        return installed(name)
    except PackageNotFoundError:
        return "not installed"
