"""Run an FMU many times, and watch the time and the memory of both processes.

    python benchmarks/checks/fmu_runs.py [--runs 10000]

The FMU is a tank under PI control, built by pythonfmu (extra `test`): 600 steps a run, with new θ
each time. Memory counts from the first `WARM` runs on, when everything is loaded. Prints the time
of a run, and how far the memory of each process went from its start. It needs Linux, and ends with
exit code 1 if the memory of a process grew by more than 5 %. 10,000 runs take a few minutes.
"""

import argparse
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from prefcal_env import End, Knob
from prefcal_env.fmu import FMULoop

sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))
from support.fmus import built

WARM = 100
"""Number of runs before the memory counts."""
BLOCK = 500
"""Number of runs between two looks at the memory."""
MOST = 0.05
"""Largest allowed growth of a process."""


def memory(pid: int | str) -> float:
    """Return the resident memory of a process, in MB."""
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * 4096 / 1e6


def main() -> int:
    """Run all, print the figures; return 1 if memory grew, else 0."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=10_000)
    runs = parser.parse_args().runs
    with tempfile.TemporaryDirectory() as folder:
        knobs = [Knob("K_p", 0.1, 100, scale="log10"), Knob("T_i", 1, 60)]
        loop = FMULoop(built(Path(folder)), knobs, ["level"], ["valve"], {"level": 2})
        rng, grown, found = np.random.default_rng(0), 0.0, {}
        begun = time.perf_counter()
        for number in range(1, runs + 1):
            experiment = loop(loop.space.decode(rng.random(2)))
            assert experiment.end is End.TIME_UP, loop.problem
            if number == WARM or (number > WARM and not number % BLOCK):
                if loop.pid is None:  # it was just replaced, and starts with the next run
                    continue
                now = {"prefcal": memory("self"), "FMU": memory(loop.pid)}
                found = found or now
                growth = {name: now[name] / found[name] - 1 for name in now}
                grown = max(grown, *growth.values())
                told = ", ".join(f"{n} {now[n]:.1f} MB ({growth[n]:+.1%})" for n in now)
                print(f"{number:6d} runs: {told}", flush=True)
        taken = (time.perf_counter() - begun) / runs
        loop.close()
    print(f"{taken * 1e3:.2f} ms a run; memory grew by {grown:.1%} at most")
    return int(grown > MOST)


if __name__ == "__main__":
    sys.exit(main())
