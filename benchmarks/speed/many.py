"""Time many random experiments on one core and on several, and measure the memory that they take.

One job and several take turns. "start" is the time until the first results have arrived; "each" is
the time per experiment after that. Processor time tells what a busy machine would hide: the work
that several jobs do beyond that of one. Cores may share a processor: the last line says how much
several processes gain that have nothing in common.
"""

import argparse
import re
import resource
import subprocess
import sys
import time
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from rich.console import Console
from rich.progress import track
from rich.table import Table

from prefcal_env import Experiment
from prefcal_scenarios import load, simulate_iter, simulate_many
from prefcal_scenarios.processes.cores import usable_cores
from prefcal_scenarios.scenario import Run, Scenario

SHARES = (0.25, 0.5, 1.0)
"""Shares of all experiments whose peak memory is compared."""


class Timing(NamedTuple):
    """Seconds of many experiments."""

    wall: float
    start: float
    each: float
    processor: float


def random_thetas(scenario: Scenario, count: int) -> Float[np.ndarray, "N n"]:
    z = np.random.default_rng(0).random((count, len(scenario.space)))
    return scenario.space.decode_all(scenario.space.snap_all(z))


def processor_seconds() -> float:
    whose = resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN
    return sum(usage.ru_utime + usage.ru_stime for usage in map(resource.getrusage, whose))


def measured(run: Run, theta: Float[np.ndarray, " n"], seed: int = 0) -> Experiment:
    """Run θ with the peak memory of its process as a KPI, in MB."""
    return replace(run(theta, seed=seed), kpis={"memory": peak_memory()})


def peak_memory() -> float:
    """Return the largest memory of this process so far, in MB; only Linux tells."""
    found = re.search(r"VmHWM:\s+(\d+) kB", Path("/proc/self/status").read_text())
    return int(found[1]) / 1024 if found else np.nan


def memory(scenario: Scenario, thetas: Float[np.ndarray, "N n"], jobs: int) -> Table:
    table = Table("experiments", "this process [MB]", "largest worker [MB]")
    measuring = replace(scenario, kpis=(), run=partial(measured, scenario.run))
    for share in SHARES:  # in this order, since peaks only grow
        count = max(round(share * len(thetas)), 1)
        results = simulate_many(measuring, thetas[:count], jobs=jobs)
        worker = max(result.kpis.get("memory", np.nan) for result in results)
        table.add_row(str(count), f"{peak_memory():.0f}", f"{worker:.0f}")
    return table


def timed(scenario: Scenario, thetas: Float[np.ndarray, "N n"], jobs: int) -> Timing:
    arrivals: list[tuple[int, float]] = []
    before, begun = processor_seconds(), time.perf_counter()
    results = simulate_iter(
        scenario, thetas, jobs=jobs, progress=lambda n, _: arrivals.append((n, time.perf_counter()))
    )
    for _ in results:  # only the count matters
        pass
    (first, t_first), (last, t_last) = arrivals[0], arrivals[-1]
    return Timing(
        time.perf_counter() - begun, t_first - begun, (t_last - t_first) / max(last - first, 1),
        processor_seconds() - before,
    )  # fmt: skip


def machine(jobs: int) -> float:
    """Return how many times as much `jobs` processes compute, each on its own, as one."""
    code = (
        "import numpy as np, time; x, A, t = np.ones(4), np.full((4, 4), 0.2), time.perf_counter()"
        "\nfor _ in range(300_000): x = np.tanh(A @ x + 0.1)\nprint(time.perf_counter() - t)"
    )

    def seconds(count: int) -> float:
        each = [subprocess.Popen([sys.executable, "-c", code], stdout=-1) for _ in range(count)]
        return float(np.mean([float(process.communicate()[0]) for process in each]))

    return jobs * seconds(1) / seconds(jobs)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenario", default="cstr")
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--jobs", type=int, default=usable_cores())
    arguments = parser.parse_args()
    console = Console()
    scenario = load(arguments.scenario)
    thetas = random_thetas(scenario, arguments.count)
    scenario.run(thetas[0])  # compiles
    console.print(memory(scenario, thetas, arguments.jobs))
    both = (1, arguments.jobs)
    rounds = [
        [timed(scenario, thetas, jobs) for jobs in both]
        for _ in track(range(arguments.rounds), "timing", console=Console(stderr=True))
    ]
    found = np.array(rounds)  # (rounds, 2, 4)
    table = Table("jobs", "wall [s]", "start [s]", "each [ms]", "processors [s]")
    for jobs, (wall, start, each, processor) in zip(both, np.median(found, axis=0), strict=True):
        table.add_row(
            str(jobs), f"{wall:.2f}", f"{start:.2f}", f"{each * 1e3:.2f}", f"{processor:.2f}"
        )
    console.print(table)
    wall, _, each, processor = np.median(found[:, 0] / found[:, 1], axis=0)
    console.print(
        f"{both[1]} jobs are {wall:.2f} times as fast as 1, {each:.2f} times after the start; "
        f"with free cores they would be {both[1] * processor:.2f} times as fast. "
        f"On this machine {both[1]} processes compute {machine(both[1]):.2f} times as much as one."
    )


if __name__ == "__main__":
    main()
