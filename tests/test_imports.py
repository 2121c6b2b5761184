"""Imports point one way and stay cheap; folders and functions stay small."""

import ast
import importlib
import re
import subprocess
import sys
from collections.abc import Collection
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

from prefcal_env.on_first_use import _MOVED

ROOT = Path(__file__).parents[1]
FOLDERS = {
    "prefcal_env": ROOT / "prefcal_env",
    "prefcal_agents": ROOT / "agents" / "prefcal_agents",
    "prefcal_scenarios": ROOT / "scenarios" / "prefcal_scenarios",
    "prefcal_app": ROOT / "app" / "prefcal_app",
    "prefcal_bench": ROOT / "benchmarks" / "prefcal_bench",
}
MAY_IMPORT = {name: {*list(FOLDERS)[: place + 1]} for place, name in enumerate(FOLDERS)}
AGENTS_MAY_USE = ("errors", "knobs", "preferences", "qp", "plain", "on_first_use", "arrays")

LAYERS = {
    "prefcal_env": (
        {"arrays", "disk", "errors", "jit", "on_first_use", "optional", "own_line", "wording"},
        {"knobs", "experiments", "qp", "plain", "described", "parquet", "workers"},
        {"preferences", "plants", "tables"},
        {"mpc", "envs", "sources", "calibrators", "study"},
        {"compiling", "controllers", "worlds"},
    ),
    "prefcal_agents": (
        {"history", "space", "support"},
        {"models", "optimize", "protocol"},
        {"acquisition", "rl", "utility"},
        {"glisp"},
        {"screening"},
        {"baselines", "minimize", "registry", "respacing", "transfer"},
    ),
    "prefcal_scenarios": (
        {"names", "own"},
        {"scenario"},
        {"described", "presentation"},
        {"cases"},
        {"catalog"},
        {"isolated", "kpis", "many", "verification", "worlds"},
    ),
    "prefcal_app": (
        {"simulating", "summary"},
        {"session"},
        {"view"},
        {"report", "terminal", "web"},
        {"looking"},
        {"cli", "worlds"},
    ),
    "prefcal_bench": (
        {"peers", "people", "reproduce"},
        {"problems"},
        {"cells"},
        {"results"},
        {"published"},
        {"__main__", "cli"},
    ),
}
"""Parts of each package, lowest first. A part may import itself and whatever is below it."""
APART = {frozenset({"mpc", "envs"})}
"""Of one layer, and yet they never import each other."""
FLOORS = 6
"""Largest number of layers of a package."""
MOST = 14
"""Largest number of modules in a folder, beside `__init__`."""
LONGEST = 40
"""Largest number of lines of a function, without its docstring."""
LONG = {
    "prefcal_env/mpc/kernels/riccati.py": "compiled: one recursion, whose steps share its arrays",
    "prefcal_env/qp/_kernels.py": "compiled: one pass over P and G, which gives six sums",
}
"""Files that may hold longer functions, and why."""
ALONE = {
    "piqp": "prefcal_env.qp",
    "pyarrow": "prefcal_env.parquet",
    "torch": ("prefcal_agents.rl", "prefcal_bench.peers"),
    "stable_baselines3": "prefcal_agents.rl",
    "glis": "prefcal_bench.peers",
    "optuna": "prefcal_bench.peers",
    "botorch": "prefcal_bench.peers",
    "gpytorch": "prefcal_bench.peers",
}
"""Foreign packages that one place alone may import, or two."""

BENCHMARKS = ROOT / "benchmarks"
TREES = {**FOLDERS, "benchmarks": BENCHMARKS}
FILES = [
    (".".join(path.relative_to(folder.parent).with_suffix("").parts), path)
    for folder in FOLDERS.values()
    for path in sorted(folder.rglob("*.py"))
]
SCRIPTS = [
    # Python starts a script with its own folder first in the path, so that names the modules.
    (".".join(parts[1:] or parts), path)
    for path in sorted(BENCHMARKS.rglob("*.py"))
    if FOLDERS["prefcal_bench"] not in path.parents
    for parts in [path.relative_to(BENCHMARKS).with_suffix("").parts]
]


IN_A_STRING = re.compile(rf"({'|'.join(FOLDERS)})\.[\w.]*(:\w*)?")
"""A module, or a name in it, that is imported by its name."""


def imported(module: str, path: Path, *, typing: bool = False) -> set[str]:
    """Full names of the modules (or of what is in them) that a file imports, at once or late.

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
                names.add(str(first.value))  # prefcal_agents.support.extras.load
        elif isinstance(node, ast.Constant) and IN_A_STRING.fullmatch(str(node.value)):
            names.add(str(node.value).replace(":", "."))
    return names


def place(name: str) -> str:
    """The part of its package that a full name is in."""
    return ".".join(name.split(".")[1:2])


@pytest.mark.parametrize(("module", "path"), FILES, ids=[name for name, _ in FILES])
def test_imports_point_down(module, path):
    package = module.split(".")[0]
    names = imported(module, path)
    ours = {name for name in names if name.split(".")[0] in FOLDERS}
    assert {name.split(".")[0] for name in ours} <= MAY_IMPORT[package]
    if package == "prefcal_agents":
        used = {place(name) for name in ours if name.startswith("prefcal_env.")}
        assert used <= set(AGENTS_MAY_USE)
    if module.count(".") > 1 or path.stem != "__init__":
        for name in (name for name in ours if name.startswith(f"{package}.")):
            here, there = place(module), place(name)
            assert level(package, there) <= level(package, here), f"{module} imports {name}"
            assert frozenset({here, there}) not in APART, f"{module} must not import {name}"
    for foreign, home in ALONE.items():
        users = {name for name in names if name.split(".")[0] == foreign}
        assert not users or module.startswith(home), f"only {home} may import {foreign}"


def level(package: str, part: str) -> int:
    found = [i for i, layer in enumerate(LAYERS[package]) if part in layer]
    assert found, f"{package}.{part} is in no layer"
    return found[0]


def test_no_package_has_more_than_six_floors():
    assert max(len(layers) for layers in LAYERS.values()) <= FLOORS


def through_doors(name: str, doors: dict[str, str], known: Collection[str]) -> str:
    """The module that a full name is from, also if the `__init__` of a package hands it on."""
    while name not in known and doors.get(name, name) != name:
        name = doors[name]
    return name if name in known else name.rpartition(".")[0]


def handed_on(files: list[tuple[str, Path]]) -> dict[str, str]:
    """Full names at the doors of packages, to those where they come from."""
    doors = {}
    for name, path in files:
        if path.stem == "__init__":
            package = name.removesuffix(".__init__")
            for origin in imported(name, path, typing=True):
                doors[f"{package}.{origin.rpartition('.')[2]}"] = origin
    return doors


def circles(files: list[tuple[str, Path]]) -> list[str] | None:
    """A circle of imports, late ones and those for type checkers included; None if there is none."""
    known = {name.removesuffix(".__init__"): path for name, path in files}
    assert len(known) == len(files), "two modules have one name"
    doors = handed_on(files)
    graph = {
        name: {through_doors(origin, doors, known) for origin in imported(name, path, typing=True)}
        & known.keys() - {name}
        for name, path in known.items()
        if path.stem != "__init__"
    }
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return list(error.args[1])
    return None


@pytest.mark.parametrize("files", [FILES, SCRIPTS], ids=["packages", "benchmarks"])
def test_no_import_goes_in_a_circle(files):
    assert circles(files) is None


@pytest.mark.parametrize(
    "back",
    [
        "from part.one import f",
        "def g():\n    from part import f",
        "if TYPE_CHECKING:\n    from . import f",
        "NAME = 'prefcal_env.part.one:f'",
    ],
)
def test_a_circle_is_found_also_if_it_is_late_or_through_a_door(tmp_path, back):
    texts = {"__init__": "from .one import f", "one": "from .two import g", "two": back}
    package = "prefcal_env.part" if "prefcal_env" in back else "part"
    files = []
    for stem, text in texts.items():
        (tmp_path / f"{stem}.py").write_text(text)
        files.append((f"{package}.{stem}", tmp_path / f"{stem}.py"))
    assert set(circles(files)) == {f"{package}.one", f"{package}.two"}
    (tmp_path / "two.py").write_text("import part.three")
    assert circles(files) is None


@pytest.mark.parametrize("folder", TREES.values(), ids=TREES)
def test_folders_stay_small_enough_to_be_seen_at_once(folder):
    for place in (folder, *(path for path in folder.rglob("*") if path.is_dir())):
        modules = [path for path in place.glob("*.py") if path.stem != "__init__"]
        assert len(modules) <= MOST, f"{place} wants a floor plan"


def lines_of(function: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    """Number of lines from `def` to the last one, without the docstring."""
    first = function.body[0]
    lines = (function.end_lineno or 0) - function.lineno + 1
    if ast.get_docstring(function) is not None:
        lines -= (first.end_lineno or 0) - first.lineno + 1
    return lines


@pytest.mark.parametrize("folder", TREES.values(), ids=TREES)
def test_functions_stay_short(folder):
    long = [
        f"{name}:{node.lineno} {node.name}: {lines_of(node)} lines"
        for path in sorted(folder.rglob("*.py"))
        if (name := path.relative_to(ROOT).as_posix()) not in LONG
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and lines_of(node) > LONGEST
    ]
    assert not long


def test_the_folders_of_packages_are_none_themselves():
    for folder in ("agents", "scenarios", "app", "benchmarks"):
        assert not (ROOT / folder / "__init__.py").exists()


@pytest.mark.parametrize(("package", "folder"), FOLDERS.items(), ids=FOLDERS)
def test_every_public_name_loads_and_is_known_to_type_checkers(package, folder):
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
    assert set(module.__all__) == typed  # as long as no optional world is left out
    assert all(getattr(module, name) is not None for name in typed)
    assert typed <= set(dir(module))


@pytest.mark.parametrize(
    ("package", "name"), [(package, name) for package, names in _MOVED.items() for name in names]
)
def test_a_name_that_left_the_door_says_where_it_is(package, name):
    with pytest.raises(ImportError, match="write `from ") as told:
        getattr(importlib.import_module(package), name)
    module = str(told.value).split()[2]
    if module != "prefcal_agents.rl":  # of an extra
        assert getattr(importlib.import_module(module), name) is not None


def public_names():
    """The names at the three doors that people import from."""
    doors = ("prefcal_env", "prefcal_agents", "prefcal_scenarios")
    return [name for package in doors for name in importlib.import_module(package).__all__]


def test_the_doors_hold_no_more_names_than_a_person_can_read():
    assert len(public_names()) <= 60


def in_a_new_process(code):
    """Run Python code that finds the five packages; what it prints."""
    path = [str(ROOT), *(str(folder.parent) for folder in FOLDERS.values())]
    program = f"import sys; sys.path[:0] = {path!r}\n{code}"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    return done.stdout.strip()


@pytest.mark.parametrize("package", FOLDERS)
def test_a_star_imports_every_public_name(package):
    names = {}
    exec(f"from {package} import *", names)
    module = importlib.import_module(package)
    assert sorted(names.keys() - {"__builtins__"}) == sorted(module.__all__)


@pytest.mark.parametrize(("package", "folder"), FOLDERS.items(), ids=FOLDERS)
def test_every_subpackage_is_there_once_the_package_is_imported(package, folder):
    parts = sorted(path.parent.name for path in folder.glob("*/__init__.py"))
    assert parts
    code = (
        f"import {package} as package\n"
        f"print([part for part in {parts!r} if not hasattr(package, part)],"
        " hasattr(package, 'no_such_part'))"
    )
    assert in_a_new_process(code) == "[] False"


def test_importing_plants_and_scenarios_loads_nothing_heavy():
    heavy = (
        "torch",
        "pygame",
        "highway_env",
        "matplotlib",
        "numba",
        "stable_baselines3",
        "pandas",
        "fmpy",
        "control",
        "casadi",
        "do_mpc",
        "asyncua",
        "scipy",
        "jaxtyping",
    )
    code = (
        "import sys, prefcal_env, prefcal_scenarios, gymnasium\n"
        f"print([m for m in {heavy!r} if m in sys.modules],"
        " sorted(i for i in gymnasium.registry if i.startswith('prefcal/')))"
    )
    ids = ["prefcal/CSTR-v0", "prefcal/CSTRTuning-v0", "prefcal/Experiment-v0"]
    ids += ["prefcal/Overtake-v0", "prefcal/OvertakeTuning-v0"]
    assert in_a_new_process(code) == f"[] {ids}"


def test_the_help_of_the_program_waits_for_no_plant():
    code = "import sys; from prefcal_bench.cli.program import main; print('gymnasium' in sys.modules)"
    assert in_a_new_process(code) == "False"
