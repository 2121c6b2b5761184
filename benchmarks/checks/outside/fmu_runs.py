"""Run an FMU many times, and measure memory of both processes and the time of a run.

    python benchmarks/checks/outside/fmu_runs.py [--runs 10000]

It builds the tank of `docs/fmu_tank.py`. Memory is measured after 500 runs (warm)
and at the end. Needs pythonfmu, and a system that has /proc.
"""

import argparse
import os
import statistics
import tempfile
import time
from pathlib import Path

import numpy as np

from prefcal_env import FMULoop, Knob

WARM = 500
DOCS = Path(__file__).parents[3] / "docs"


def resident(pid: int) -> float:
    """Return the resident memory of a process in MB."""
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def tank(folder: Path) -> Path:
    from pythonfmu import FmuBuilder

    FmuBuilder.build_FMU(DOCS / "fmu_tank.py", dest=folder)
    return folder / "Tank.fmu"


def measured(loop: FMULoop, runs: int) -> None:
    rng = np.random.default_rng(0)
    times, inside, ours, theirs = [], [], [], []
    for number in range(runs):
        theta = loop.space.decode(rng.random(len(loop.space)))
        begun = time.perf_counter()
        experiment = loop(theta)
        times.append(time.perf_counter() - begun)
        assert len(experiment.t), loop.problem
        inside.append(loop.seconds or 0.0)
        # The process is replaced now and then: it is measured whenever there is one.
        if number >= WARM and number % 100 == 99 and loop.pid is not None:
            ours.append(resident(os.getpid()))
            theirs.append(resident(loop.pid))
    print(f"{runs} runs of {len(experiment.t)} instants")
    print(f"a run: median {1e3 * statistics.median(times):.2f} ms, mean {1e3 * np.mean(times):.2f}")
    print(f"of which the FMU: median {1e3 * statistics.median(inside):.2f} ms")
    for name, used in (("prefcal", ours), ("the FMU's process", theirs)):
        print(
            f"memory of {name}: {used[0]:.1f} MB after {WARM} runs, {used[-1]:.1f} MB at the end "
            f"({100 * (used[-1] / used[0] - 1):+.1f} %), at most {max(used):.1f} MB"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=10_000)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        knobs = [Knob("K_p", 0.1, 10.0, scale="log10"), Knob("T_i", 1.0, 60.0)]
        loop = FMULoop(tank(Path(folder)), knobs, ["level"], ["valve"], {"level": 2.0})
        measured(loop, options.runs)
        loop.close()


if __name__ == "__main__":
    main()
