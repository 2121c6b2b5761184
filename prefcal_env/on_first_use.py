"""Import the public names of a package on first use, so that scripts pay only for what they use."""

import ast
from collections.abc import Callable, Iterator
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from sys import modules
from typing import Any, NamedTuple


class Door(NamedTuple):
    """The `__getattr__`, `__dir__` and `__all__` of a package."""

    load: Callable[[str], Any]
    listed: Callable[[], list[str]]
    names: list[str]


@cache
def public_names(package: str) -> Door:
    """Return what the `__init__` of a package defines to import its public names on first use.

    They are the names that it imports `if TYPE_CHECKING:`, where type checkers and editors see
    them, too. Its modules are also imported on first use.

    Args:
        package: Name of the package, `__name__` in its `__init__`.
    """
    module = modules[package]
    # Not `inspect.getsource`, which asks the module for names that it has not.
    source: str = module.__loader__.get_source(package)  # type: ignore[union-attr]
    homes = {
        name: home
        for name, home in _typed(source)
        # An optional world may be left out.
        if not home.startswith("worlds.") or find_spec(f"{package}.{home}") is not None
    }

    def load(name: str) -> Any:
        if name == "__all__":
            return sorted(homes)
        if name in homes:
            found = getattr(import_module(f".{homes[name]}", package), name)
            setattr(module, name, found)  # so that the next time costs nothing
            return found
        if not name.startswith("_") and find_spec(f"{package}.{name}") is not None:
            return import_module(f".{name}", package)
        raise AttributeError(f"module {package!r} has no attribute {name!r}")

    return Door(load, lambda: sorted({*vars(module), *homes}), sorted(homes))


def _typed(source: str) -> Iterator[tuple[str, str]]:
    """Yield each name that is imported for type checkers alone, and its module in the package."""
    for node in ast.parse(source).body:
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test):
            for found in node.body:
                if isinstance(found, ast.ImportFrom):
                    yield from ((alias.name, found.module or "") for alias in found.names)
