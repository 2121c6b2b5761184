"""Time single experiments over random θ, each beside a fixed piece of numpy work.

    python benchmarks/speed/experiments.py [--count 100] [--scenarios cstr overtake servo]

Prints the median and the 95 % quantile in ms of processor time, and the median ratio to the numpy
work that runs directly before each experiment: on a busy or slower machine the ratio stays.
"""

import argparse
import time

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from prefcal_scenarios import load

SCENARIOS = ["cstr", "overtake", "servo", "mpc-quadruple-tank"]
STDERR = Console(stderr=True)


def yardstick() -> float:
    """Return the ms of a fixed piece of numpy work: many calls on tiny arrays."""
    start, x, A = time.process_time(), np.ones(4), np.full((4, 4), 0.2)
    for _ in range(2000):
        x = np.tanh(A @ x + 0.1)
    return 1e3 * (time.process_time() - start)


def times(name: str, count: int) -> np.ndarray:
    """Return the ms of `count` experiments and of the yardstick before each, shape (count, 2)."""
    scenario, rng = load(name), np.random.default_rng(7)
    thetas = [scenario.space.decode(rng.random(len(scenario.space))) for _ in range(count + 1)]
    scenario.run(thetas[0])  # compiles
    found = []
    for theta in track(thetas[1:], name, console=STDERR):
        beside, start = yardstick(), time.process_time()
        scenario.run(theta)
        found.append((1e3 * (time.process_time() - start), beside))
    return np.array(found)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--scenarios", nargs="+", default=SCENARIOS)
    arguments = parser.parse_args()
    table = Table("scenario", "median [ms]", "95 % [ms]", "numpy work [ms]", "median ratio")
    for name in arguments.scenarios:
        found = times(name, arguments.count)
        middle, most = np.percentile(found[:, 0], [50, 95])
        ratio, work = np.median(found[:, 0] / found[:, 1]), np.median(found[:, 1])
        table.add_row(name, *(f"{v:.2f}" for v in (middle, most, work, ratio)))
    Console().print(table)


if __name__ == "__main__":
    main()
