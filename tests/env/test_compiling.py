"""What is compiled beforehand is all that a run needs, and only what is missing is told."""

import json
import subprocess
import sys

import pytest

SCRIPT = """
import json, sys
import numpy as np
from numba.core import event
from prefcal_env.compiling import compile_missing
from prefcal_scenarios import load

class Compiled(event.Listener):
    names = []
    def on_start(self, event): self.names.append(event.data["dispatcher"].py_func.__name__)
    def on_end(self, event): pass

scenario = load(sys.argv[1])
told = []
compile_missing(told.append)
event.register("numba:compile", Compiled())
scenario.run(scenario.space.decode(np.full(len(scenario.space), 0.5)))
print(json.dumps({"told": [t.words for t in told], "later": Compiled.names}))
"""


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    return tmp_path_factory.mktemp("cache")


def run(scenario, cache):
    environment = {"NUMBA_CACHE_DIR": str(cache), "PYTHONPATH": ":".join(sys.path)}
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT, scenario],
        capture_output=True,
        text=True,
        check=True,
        env=environment,
        timeout=300,
    )
    return json.loads(done.stdout)


def test_a_run_compiles_nothing_after_the_parts_that_were_told(cache):
    first = run("cstr", cache)
    assert first["later"] == []
    count = len(first["told"])
    assert count > 3
    for k, words in enumerate(first["told"]):
        assert words.startswith(f"Compiling the solver, part {k + 1} of {count} (")
    assert run("overtake", cache)["later"] == []
    for scenario in ("cstr", "overtake"):
        assert run(scenario, cache) == {"told": [], "later": []}


def test_a_loop_without_an_mpc_compiles_no_mpc(cache, tmp_path):
    first = run("servo", tmp_path)
    assert first["later"] == []
    assert len(first["told"]) == 1
    assert "part 1 of 1 (closed loop)" in first["told"][0]


def test_a_loop_with_an_mpc_compiles_its_plant_beforehand(cache):
    first = run("mpc-oscillatory", cache)
    assert first["later"] == []
    assert "(correction of the estimator)" in first["told"][-1]
