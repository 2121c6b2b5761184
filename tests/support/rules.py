"""Rules of the house, for any package: imports point down, folders and functions are small."""

import ast
import importlib
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

from support.new_process import in_a_new_process

Layers = Sequence[Collection[str]]
"""Parts of a package, lowest first. A part may import itself and whatever is not above it."""
MOST = 14
"""Largest number of modules in a folder, beside `__init__`."""
LONGEST = 40
"""Largest number of lines of a function, without its docstring."""
IN_A_STRING = re.compile(r"(prefcal_\w+)\.[\w.]*(:\w*)?")
"""A module, or a name in it, that is imported by its name."""


def modules_of(folders: Mapping[str, Path]) -> list[tuple[str, Path]]:
    """Return the full names of all modules of these packages, and their files."""
    return [
        (".".join(path.relative_to(folder.parent).with_suffix("").parts), path)
        for folder in folders.values()
        for path in sorted(folder.rglob("*.py"))
    ]


def imported(module: str, path: Path, *, typing: bool = False) -> set[str]:
    """Return full names of the modules (or of what is in them) that a file imports, at once or late.

    Those for type checkers alone count only if `typing`.
    """
    names = set()
    package = module.split(".") if path.stem == "__init__" else module.split(".")[:-1]
    package = [part for part in package if part != "__init__"]
    tree = ast.parse(path.read_text(encoding="utf-8"))
    typing_only = {
        id(inner)
        for node in ast.walk(tree)
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test)
        for inner in ast.walk(node)
    }
    for node in ast.walk(tree):
        if id(node) in typing_only and not typing:
            continue
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            origin = ".".join([*base, *([node.module] if node.module else [])])
            names |= {f"{origin}.{alias.name}" for alias in node.names}
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.args:
            first = node.args[0]
            if node.func.id.startswith("load") and isinstance(first, ast.Constant):
                names.add(str(first.value))  # what an extra installs is loaded by name
        elif isinstance(node, ast.Constant) and IN_A_STRING.fullmatch(str(node.value)):
            names.add(str(node.value).replace(":", "."))
    return names


def place(name: str) -> str:
    """Return the part of its package that a full name is in."""
    return ".".join(name.split(".")[1:2])


def assert_imports_point_down(
    module: str,
    path: Path,
    below: Collection[str],
    layers: Layers,
    alone: Mapping[str, str | tuple[str, ...]],
) -> set[str]:
    """Check what a file imports, and return it.

    Of our packages it imports its own and those `below`, of its own nothing that is in a higher one
    of the `layers`, and what `alone` names only where that says.
    """
    package, names = module.split(".")[0], imported(module, path)
    ours = {name for name in names if name.startswith("prefcal_")}
    assert {name.split(".")[0] for name in ours} <= {package, *below}
    if module.count(".") > 1 or path.stem != "__init__":
        for name in (name for name in ours if name.startswith(f"{package}.")):
            here, there = (level(layers, place(each)) for each in (module, name))
            assert there <= here, f"{module} imports {name}"
    for foreign, home in alone.items():
        users = {name for name in names if name.split(".")[0] == foreign}
        assert not users or module.startswith(home), f"only {home} may import {foreign}"
    return names


def level(layers: Layers, part: str) -> int:
    """Return the layer that a part is in."""
    found = [i for i, layer in enumerate(layers) if part in layer]
    assert found, f"{part} is in no layer"
    return found[0]


def _through_doors(name: str, doors: Mapping[str, str], known: Collection[str]) -> str:
    """Return the module that a full name is from, also if the `__init__` of a package hands it on."""
    while name not in known and doors.get(name, name) != name:
        name = doors[name]
    return name if name in known else name.rpartition(".")[0]


def _handed_on(files: Sequence[tuple[str, Path]]) -> dict[str, str]:
    """Return full names at the doors of packages, to those where they come from."""
    doors = {}
    for name, path in files:
        if path.stem == "__init__":
            package = name.removesuffix(".__init__")
            for origin in imported(name, path, typing=True):
                doors[f"{package}.{origin.rpartition('.')[2]}"] = origin
    return doors


def circle(files: Sequence[tuple[str, Path]]) -> list[str] | None:
    """Return a circle of imports, late ones and those for type checkers included; None if there is none."""
    known = {name.removesuffix(".__init__"): path for name, path in files}
    assert len(known) == len(files), "two modules have one name"
    doors = _handed_on(files)
    graph = {
        name: {_through_doors(origin, doors, known) for origin in imported(name, path, typing=True)}
        & known.keys() - {name}
        for name, path in known.items()
        if path.stem != "__init__"
    }
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return list(error.args[1])
    return None


def assert_folders_stay_small(folder: Path, leave_out: Iterable[Path] = ()) -> None:
    """Check that a folder and those in it can be seen at once."""
    for inside in (folder, *(path for path in folder.rglob("*") if path.is_dir())):
        modules = [path for path in inside.glob("*.py") if path.stem != "__init__"]
        out = any(inside.is_relative_to(each) for each in leave_out)
        assert out or len(modules) <= MOST, f"{inside} wants a floor plan"


def lines_of(function: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    """Return the number of lines from `def` to the last one, without the docstring."""
    first = function.body[0]
    lines = (function.end_lineno or 0) - function.lineno + 1
    if ast.get_docstring(function) is not None:
        lines -= (first.end_lineno or 0) - first.lineno + 1
    return lines


def long_functions(folder: Path, leave_out: Collection[Path] = ()) -> list[str]:
    """Return the functions below a folder that are too long, with their lines."""
    return [
        f"{path}:{node.lineno} {node.name}: {lines_of(node)} lines"
        for path in sorted(folder.rglob("*.py"))
        if not any(path.is_relative_to(each) for each in leave_out)
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and lines_of(node) > LONGEST
    ]


def assert_every_public_name_loads(package: str, folder: Path) -> None:
    """Check that the names that a package exports are there, and known to type checkers."""
    module = importlib.import_module(package)
    tree = ast.parse((folder / "__init__.py").read_text(encoding="utf-8"))
    typed = {
        alias.asname
        for node in tree.body
        if isinstance(node, ast.If)
        for inner in node.body
        if isinstance(inner, ast.ImportFrom)
        for alias in inner.names
    }
    assert set(module.__all__) == typed
    assert all(getattr(module, str(name)) is not None for name in typed)
    assert typed <= set(dir(module))


def assert_a_star_imports_every_public_name(package: str) -> None:
    """Check `from package import *`."""
    names: dict[str, object] = {}
    exec(f"from {package} import *", names)
    module = importlib.import_module(package)
    assert sorted(names.keys() - {"__builtins__"}) == sorted(module.__all__)


def assert_every_subpackage_is_there(package: str, folder: Path) -> None:
    """Check that the subpackages are attributes of a package once it is imported, and nothing else."""
    parts = sorted(path.parent.name for path in folder.glob("*/__init__.py"))
    assert parts
    code = (
        f"import {package} as package\n"
        f"print([part for part in {parts!r} if not hasattr(package, part)],"
        " hasattr(package, 'no_such_part'))"
    )
    assert in_a_new_process(code) == "[] False"
