"""Without a world's folders and its row, all others work, and asking for it gives one clear line."""

import ast
import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from importlib.util import resolve_name
from pathlib import Path

import pytest

from prefcal_env.optional import WORLDS

ROOT = Path(__file__).parents[2]
HOMES = {
    "prefcal_env": ".",
    "prefcal_agents": "agents",
    "prefcal_scenarios": "scenarios",
    "prefcal_app": "app",
}
DOORS = [ROOT / "prefcal_env" / "__init__.py", ROOT / "app" / "prefcal_app" / "__init__.py"]
NAMES = [world.name for world in WORLDS]
TOLD = """
import contextlib, io, json, os, pkgutil
from importlib import import_module

import numpy as np

import prefcal_app, prefcal_env, prefcal_scenarios
from contracts.sources import CONTRACT
from prefcal_app.cli import main
from prefcal_env.sources.source import Function
from support.device import Device
from support.short_runs import short_run

def prefcal(line):
    sys.argv, code = ["prefcal", *line.split()], 0
    with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.redirect_stderr(io.StringIO()) as err:
        try:
            main()
        except SystemExit as end:
            code = end.code or 0
    return code, out.getvalue(), err.getvalue()

for package in (prefcal_env, prefcal_scenarios, prefcal_app):
    assert package.__file__.startswith(os.getcwd()), package.__file__
    for found in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
        if ".worlds." not in found.name:
            import_module(found.name)
function = Function(lambda theta, seed=0: short_run(theta))
rig = prefcal_env.Rig(
    prefcal_env.Channels((), (prefcal_env.Channel("valve"),), (prefcal_env.Channel("level"),)), (1.0,)
)
for source, theta in ((function, [1.0, 0.5]), (rig, [1.0, 0.5]), (Device(), [2.0, 30.0])):
    for clause in CONTRACT:
        clause(source, np.array(theta))
try:
    prefcal_env.optional.world(NAME)
except prefcal_env.PrefcalError as error:
    asked = str(error)
servo = "calibrate servo --calibrator synthetic --cost overshoot --agent random --n-max 2 --simulate 0"
lines = ("--help", "scenarios", "new --help", "calibrate --help", f"{servo} --out made",
         "calibrate loop.fmu --calibrator synthetic", "calibrate tank.toml --calibrator synthetic")
told = {line.partition(" --c")[0]: prefcal(line) for line in lines}
print(json.dumps([asked, dir(prefcal_env) + dir(prefcal_app), told]))
"""


def without(name, folder):
    """Copy the packages of the product, but for one world, into a folder."""
    for package, home in HOMES.items():
        copied = folder / home / package
        ignored = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / home / package, copied, ignore=ignored)
        shutil.rmtree(copied / "worlds" / name, ignore_errors=True)
        (copied / "worlds" / f"{name}.py").unlink(missing_ok=True)
    table = folder / "prefcal_env" / "optional.toml"
    head, *rows = re.split(r"(?m)^(?=\[\[world\]\])", table.read_text("utf-8"))
    left = [row for row in rows if f'\nname = "{name}"\n' not in row]
    assert len(left) == len(rows) - 1
    table.write_text(head + "".join(left), "utf-8")
    return folder


def ran(folder, code):
    """Run code that finds the copied packages first, in the folder; exit code, stdout and stderr."""
    path = [str(folder / home) for home in HOMES.values()] + [str(ROOT / "tests")]
    kept = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    words = [sys.executable, "-c", f"import sys\nsys.path[:0] = {path!r}\n{code}"]
    told = subprocess.run(words, cwd=folder, env=kept, capture_output=True, text=True, timeout=900)
    return told.returncode, told.stdout, told.stderr


ASKED = {
    "fmu": ("calibrate loop.fmu", "no scenario is called 'loop.fmu'"),
    "live": ("calibrate tank.toml", "there is no key 'opcua'"),
}
PUBLIC = {"fmu": "FMULoop", "do_mpc": "DoMPC", "notebook": "ask"}


@pytest.mark.parametrize("name", NAMES)
def test_all_else_works_and_asking_for_it_gives_one_clear_line(name, tmp_path):
    """One process for all of it, since it loads everything."""
    folder = without(name, tmp_path)
    (folder / "tank.toml").write_text('[opcua]\nurl = "opc.tcp://127.0.0.1:4840"\n')
    code, out, err = ran(folder, f"NAME = {name!r}\n{TOLD}")
    assert code == 0, err
    asked, listed, told = json.loads(out)
    for line in ("--help", "scenarios", "new --help", "calibrate --help", "calibrate servo"):
        code, out, err = told[line]
        assert code == 0, err
        # Some names are words of English.
        assert name in ("control", "live", "notebook") or not re.search(rf"\b{name}\b", out), line
    assert (folder / "made" / "best.json").is_file()
    assert asked.startswith(f"no optional world is called {name!r}.")
    assert {world for world, public in PUBLIC.items() if public not in listed} == {name} & PUBLIC.keys()
    if name in ASKED:
        line, said = ASKED[name]
        code, _, err = told[line]
        assert code == 2
        assert said in err
        assert len(err.strip().splitlines()) == 1


def named_in(path, package, name):
    """Lines of a file that import a world, or name its module in a string."""
    module = re.compile(rf"\bworlds[./]{name}\b")
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        found = []
        if isinstance(node, ast.Import):
            found = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            origin = "." * node.level + (node.module or "")
            origin = resolve_name(origin, package) if node.level else origin
            found = [f"{origin}.{alias.name}" for alias in node.names]
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            found = [node.value]
        if any(map(module.search, found)):
            yield node.lineno


def who_names(name, root):
    """Files of the product outside of a world that name its module, and the lines."""
    for package, home in HOMES.items():
        for path in sorted((root / home / package).rglob("*.py")):
            inside = path.relative_to(root / home / package).with_suffix("").parts
            if inside[:2] != ("worlds", name):
                where = ".".join((package, *inside[:-1]))
                yield from (f"{path.relative_to(root)}:{line}" for line in named_in(path, where, name))


@pytest.mark.parametrize("name", NAMES)
def test_no_other_module_names_it(name):
    doors = tuple(f"{path.relative_to(ROOT)}:" for path in DOORS)  # names for type checkers
    assert [place for place in who_names(name, ROOT) if not place.startswith(doors)] == []


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(
    "text",
    [
        "import prefcal_env.worlds.{0}",
        "def f():\n    from ..worlds import {0}",
        "def f():\n    from ..worlds.{0} import x",
        "HOME = 'prefcal_env.worlds.{0}:x'",
    ],
)
def test_a_module_that_names_it_is_found(tmp_path, name, text):
    package = tmp_path / "prefcal_env" / "sources"
    package.mkdir(parents=True)
    (package / "new.py").write_text(text.format(name))
    assert [place.partition(":")[0] for place in who_names(name, tmp_path)] == ["prefcal_env/sources/new.py"]


def test_a_module_that_imports_it_breaks_without_it(tmp_path):
    folder = without("casadi", tmp_path)
    (folder / "prefcal_env" / "wording.py").write_text("import prefcal_env.worlds.casadi\n")
    code, _, err = ran(folder, "import prefcal_env.wording")
    assert code == 1
    assert "No module named 'prefcal_env.worlds.casadi'" in err


def test_every_extra_of_the_table_installs_its_library():
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["optional-dependencies"]
    for world in WORLDS:
        installed = {re.split(r"[<>=\[]", line)[0].replace("-", "_") for line in extras[world.extra]}
        assert world.library in installed
