"""What is compiled beforehand is all that a run needs, and only what is missing is told."""

import json
import subprocess
import sys

SCRIPT = """
import json, sys
import numpy as np
from numba.core import event
from prefcal_env.mpc.compiling import compile_missing
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


def run(scenario, cache):
    environment = {"NUMBA_CACHE_DIR": str(cache), "PYTHONPATH": ":".join(sys.path)}
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT, scenario],
        capture_output=True, text=True, check=True, env=environment, timeout=300,
    )  # fmt: skip
    return json.loads(done.stdout)


def test_a_run_compiles_nothing_after_the_parts_that_were_told(tmp_path):
    first = run("cstr", tmp_path)
    assert first["later"] == []
    assert len(first["told"]) == 10
    assert first["told"][2].startswith("Compiling the solver, part 3 of 10 (optimal feedback)")
    for scenario in ("cstr", "overtake", "overtake-robust"):
        again = run(scenario, tmp_path)
        assert again == {"told": [], "later": []}
