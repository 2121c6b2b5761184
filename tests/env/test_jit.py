"""Compiled code: what a run needs, is there, outlives an installation and never its sources."""

import json
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from support.processes import start

ROOT = Path(__file__).parents[2]
KERNELS = """
from prefcal_env.jit import kernel
from .inside import SLOPE, twice

@kernel()
def line(x):
    return twice(x) + SLOPE
"""
INSIDE = """
from prefcal_env.jit import inner

SLOPE = {slope}

@inner()
def twice(x):
    return 2.0 * x
"""
SCRIPT = """
from prefcal_toy.kernels import line
value = line(1.0)
print(value, sum(line.stats.cache_hits.values()))
"""


def install(folder, slope=1.0):
    """Write a package with a kernel that depends on another file of it; return its folder."""
    package = folder / "prefcal_toy"
    package.mkdir(parents=True)
    (package / "__init__.py").touch()
    (package / "kernels.py").write_text(KERNELS)
    (package / "inside.py").write_text(INSIDE.format(slope=slope))
    return folder


def run(folder, cache):
    """Return the value of the kernel, and how often numba's cache held it."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(cache)}
    environment["PYTHONPATH"] = os.pathsep.join([str(folder), str(ROOT)])
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=True, env=environment
    )
    value, hits = done.stdout.split()
    return float(value), int(hits)


def test_another_installation_of_the_same_sources_compiles_nothing(tmp_path):
    cache = tmp_path / "cache"
    assert run(install(tmp_path / "one"), cache) == (3.0, 0)
    assert run(install(tmp_path / "two"), cache) == (3.0, 1)


def test_a_change_of_an_imported_file_compiles_again(tmp_path):
    cache = tmp_path / "cache"
    assert run(install(tmp_path / "old"), cache) == (3.0, 0)
    assert run(install(tmp_path / "new", slope=5.0), cache) == (7.0, 0)
    assert run(tmp_path / "old", cache) == (3.0, 1)


def test_the_code_of_old_versions_is_removed(tmp_path):
    cache = tmp_path / "cache"
    for slope in range(5):
        run(install(tmp_path / str(slope), slope=float(slope)), cache)
    assert len(list(cache.rglob("prefcal_toy.kernels-*/*.nbc"))) == 4
    assert run(tmp_path / "4", cache) == (6.0, 1)
    assert run(tmp_path / "0", cache) == (2.0, 0)


def test_a_folder_that_is_not_writable_only_costs_time(tmp_path):
    cache = tmp_path / "file"
    cache.touch()  # no folder can be made below a file, not even by an administrator
    folder = install(tmp_path / "one")
    assert run(folder, cache) == (3.0, 0)
    assert run(folder, cache) == (3.0, 0)


def test_a_change_of_a_file_that_kernels_do_not_import_compiles_nothing(tmp_path):
    cache = tmp_path / "cache"
    run(install(tmp_path / "one"), cache)
    (install(tmp_path / "two") / "prefcal_toy" / "page.py").write_text("TITLE = 'new'")
    assert run(tmp_path / "two", cache) == (3.0, 1)


def test_two_processes_that_compile_at_once_leave_a_cache_that_works(tmp_path):
    cache, folder = tmp_path / "cache", install(tmp_path / "one")
    with ThreadPoolExecutor(2) as pool:
        both = list(pool.map(lambda _: run(folder, cache), range(2)))
    assert [value for value, _ in both] == [3.0, 3.0]
    assert run(folder, cache) == (3.0, 1)


COMPILES = """
import json, sys
import numpy as np
from numba.core import event
from prefcal_scenarios import load
from prefcal_scenarios.runs import compile_runs

class Compiled(event.Listener):
    names = []
    def on_start(self, event): self.names.append(event.data["dispatcher"].py_func.__name__)
    def on_end(self, event): pass

scenario = load(sys.argv[1])
told = []
if sys.argv[2] == "ahead":
    compile_runs(scenario, told.append)
event.register("numba:compile", Compiled())
scenario.run(scenario.space.decode(np.full(len(scenario.space), 0.5)))
print(json.dumps({"told": [t.words for t in told], "later": Compiled.names}))
"""


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    return tmp_path_factory.mktemp("cache")


def compiled_in(scenario, cache, how="ahead"):
    environment = {"NUMBA_CACHE_DIR": str(cache), "PYTHONPATH": ":".join(sys.path)}
    done = subprocess.run(
        [sys.executable, "-c", COMPILES, scenario, how],
        capture_output=True,
        text=True,
        check=True,
        env=environment,
        timeout=300,
    )
    return json.loads(done.stdout)


def test_a_run_compiles_nothing_after_the_parts_that_were_told(cache):
    first = compiled_in("cstr", cache)
    assert first["later"] == []
    count = len(first["told"])
    assert count > 3
    for k, words in enumerate(first["told"]):
        assert words.startswith(f"Compiling the solver, part {k + 1} of {count} (")
    assert compiled_in("overtake", cache)["later"] == []
    for scenario in ("cstr", "overtake"):
        assert compiled_in(scenario, cache) == {"told": [], "later": []}


@pytest.mark.parametrize("scenario", ["cstr", "servo"])
def test_workers_compile_nothing_that_was_compiled_ahead(cache, scenario):
    compiled_in(scenario, cache)
    assert compiled_in(scenario, cache, "never")["later"] == []


def test_a_loop_without_an_mpc_compiles_no_mpc(cache, tmp_path):
    first = compiled_in("servo", tmp_path)
    assert first["later"] == []
    assert len(first["told"]) == 1
    assert "part 1 of 1 (closed loop)" in first["told"][0]


def test_a_loop_with_an_mpc_compiles_its_plant_beforehand(cache):
    first = compiled_in("mpc-oscillatory", cache)
    assert first["later"] == []
    assert "(correction of the estimator)" in first["told"][-1]


@pytest.mark.parametrize("scenario", ["docs/dc_motor.py:motor", 'pid {"plant": "docs/dc_motor.py:plant"}'])
def test_a_loop_of_our_pids_is_compiled_beforehand_whoever_made_it(tmp_path, scenario):
    first = compiled_in(scenario, tmp_path)
    assert first["later"] == []
    assert "part 1 of 1 (closed loop)" in first["told"][0]


def test_a_controller_of_ones_own_compiles_no_loop(cache):
    assert compiled_in("docs/heated_tank.py:heated_tank", cache)["told"] == []


@pytest.mark.parametrize("command", ["check", "verify"])
def test_a_command_says_once_in_a_log_that_it_compiles(tmp_path, command):
    """Otherwise nothing is said for many seconds where no study ran before."""
    theta = {"K": 2.0, "T_i": 20.0, "T_d": 3.0, "T_f": 3.0, "b": 0.5, "T_t": 20.0}
    content = {"format": 1, "scenario": "lag", "theta": theta, "settings": {}}
    (tmp_path / "best.json").write_text(json.dumps(content))
    words = {"check": ["check", "lag"], "verify": ["verify", "best.json", "--runs", "2", "--jobs", "1"]}[
        command
    ]
    told = "Compiling the solver, part 1 of 1 (closed loop): only this once on this machine"
    for expected in ([told], []):
        process = start(tmp_path, *words, NUMBA_CACHE_DIR=str(tmp_path / "cache"))
        out, err = process.communicate(timeout=200)
        assert process.returncode == 0, err
        assert [line for line in err.splitlines() if "Compiling" in line] == expected
        assert "Compiling" not in out
