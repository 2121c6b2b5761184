"""Imports point one way and stay cheap; folders and functions stay small."""

import importlib
from pathlib import Path

import pytest

from support.new_process import in_a_new_process
from support.rules import (
    assert_a_star_imports_every_public_name,
    assert_every_public_name_loads,
    assert_every_subpackage_is_there,
    assert_folders_stay_small,
    assert_imports_point_down,
    circle,
    long_functions,
    modules_of,
    place,
)

ROOT = Path(__file__).parents[1]
FOLDERS = {
    "prefcal_env": ROOT / "prefcal_env",
    "prefcal_agents": ROOT / "agents" / "prefcal_agents",
    "prefcal_scenarios": ROOT / "scenarios" / "prefcal_scenarios",
    "prefcal_app": ROOT / "app" / "prefcal_app",
}
MAY_IMPORT = {name: list(FOLDERS)[:number] for number, name in enumerate(FOLDERS)}
AGENTS_MAY_USE = (
    "errors",
    "optional",
    "knobs",
    "preferences",
    "qp",
    "plain",
    "on_first_use",
    "arrays",
    "units",
)

LAYERS = {
    "prefcal_env": (
        {"arrays", "disk", "errors", "jit", "on_first_use", "optional", "units", "wording"},
        {"knobs", "experiments", "qp", "plain", "workers"},
        {"preferences", "plants", "tables"},
        {"mpc", "envs", "sources", "calibrators", "study"},
        {"compiling", "controllers", "worlds"},
    ),
    "prefcal_agents": (
        {"lessons", "surrogate"},
        {"people", "search"},
        {"agent", "learned_cost", "result", "taste"},
        {"glisp"},
        {"screening"},
        {"baselines", "minimize", "registry", "transfer"},
    ),
    "prefcal_scenarios": (
        {"names", "own"},
        {"scenario"},
        {"choosing", "described", "style", "wording"},
        {"cases"},
        {"catalog"},
        {"isolated", "runs", "verification", "worlds"},
    ),
    "prefcal_app": (
        {"simulating", "summary"},
        {"session"},
        {"view"},
        {"report", "terminal", "web"},
        {"looking"},
        {"__main__", "cli", "worlds"},
    ),
}
"""Parts of each package, lowest first. A part may import itself and whatever is below it."""
APART = {frozenset({"mpc", "envs"})}
"""Of one layer, and yet they never import each other."""
FLOORS = 6
"""Largest number of layers of a package."""
LONG = {
    "prefcal_env/mpc/kernels.py": "compiled: one recursion, whose steps share its arrays",
    "prefcal_env/qp/_active_set.py": "compiled: one pass over P and G, which gives six sums",
}
"""Files that may hold longer functions, and why."""
SHORTEST = 80
"""Smallest number of lines of a file: what is read together stands together."""
SHORT = {
    "app/prefcal_app/__main__.py": "what `python -m prefcal_app` runs",
    "prefcal_env/disk.py": "durable writing, which all others rely on and nothing else may do",
    "prefcal_env/on_first_use.py": "imported with every package: it loads nothing",
    "prefcal_env/study/beside.py": "what may be lost, for the session and for the pool of simulations",
    "prefcal_env/worlds/control.py": "an optional world",
    "prefcal_env/worlds/do_mpc.py": "an optional world",
    "scenarios/prefcal_scenarios/worlds/live.py": "an optional world",
    "scenarios/prefcal_scenarios/worlds/optuna.py": "an optional world",
}
"""Shorter files, and why."""
ALONE = {
    "piqp": "prefcal_env.qp",
    "pyarrow": "prefcal_env.tables.sheet",
    "python_calamine": "prefcal_env.tables.sheet",
}
"""Foreign packages that one place alone may import."""
BENCHMARK = "_".join(("prefcal", "bench"))
"""A distribution of its own: what is here neither imports nor names it."""
FILES = modules_of(FOLDERS)


@pytest.mark.parametrize(("module", "path"), FILES, ids=[name for name, _ in FILES])
def test_imports_point_down(module, path):
    package = module.split(".")[0]
    names = assert_imports_point_down(module, path, MAY_IMPORT[package], LAYERS[package], ALONE)
    if package == "prefcal_agents":
        used = {place(name) for name in names if name.startswith("prefcal_env.")}
        assert used <= set(AGENTS_MAY_USE)
    for name in (name for name in names if name.startswith(f"{package}.")):
        assert frozenset({place(module), place(name)}) not in APART, f"{module} must not import {name}"


@pytest.mark.parametrize("folder", [*FOLDERS.values(), ROOT / "tests"], ids=[*FOLDERS, "tests"])
def test_nothing_imports_or_names_the_benchmark(folder):
    assert [path for path in folder.rglob("*.py") if BENCHMARK in path.read_text(encoding="utf-8")] == []


def test_no_package_has_more_than_six_floors():
    assert max(len(layers) for layers in LAYERS.values()) <= FLOORS


def test_no_import_goes_in_a_circle():
    assert circle(FILES) is None


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
    assert set(circle(files)) == {f"{package}.one", f"{package}.two"}
    (tmp_path / "two.py").write_text("import part.three")
    assert circle(files) is None


@pytest.mark.parametrize("folder", FOLDERS.values(), ids=FOLDERS)
def test_folders_and_functions_stay_small_enough_to_be_seen_at_once(folder):
    assert_folders_stay_small(folder)
    assert long_functions(folder, {ROOT / path for path in LONG}) == []


@pytest.mark.parametrize(("package", "folder"), FOLDERS.items(), ids=FOLDERS)
def test_what_a_package_exports_is_there_and_known_to_type_checkers(package, folder):
    assert_every_public_name_loads(package, folder)
    assert_a_star_imports_every_public_name(package)
    assert_every_subpackage_is_there(package, folder)


def test_files_are_rooms_and_not_closets():
    short = {
        path.relative_to(ROOT).as_posix()
        for _, path in FILES
        if path.stem != "__init__" and len(path.read_bytes().splitlines()) < SHORTEST
    }
    assert short == SHORT.keys()


def test_the_folders_of_packages_are_none_themselves():
    for folder in ("agents", "scenarios", "app"):
        assert not (ROOT / folder / "__init__.py").exists()


def public_names():
    """The names at the three doors that people import from."""
    doors = ("prefcal_env", "prefcal_agents", "prefcal_scenarios")
    return [name for package in doors for name in importlib.import_module(package).__all__]


def test_the_doors_hold_no_more_names_than_a_person_can_read():
    assert len(public_names()) <= 60


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
    code = "import sys; from prefcal_app.cli import main; print('gymnasium' in sys.modules)"
    assert in_a_new_process(code) == "False"
