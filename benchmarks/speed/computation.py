"""Fit the model of a step's computation time on this machine, and show how well it fits.

    OMP_NUM_THREADS=1 python benchmarks/speed/computation.py [--rounds 15]

The measurement is that of `prefcal processor measure`: every step of closed-loop runs of the car,
with small and large horizons, is timed `rounds` times, and its shortest time counts. Prints the
four coefficients, measured and modeled times by problem size, and how much slower a processor must
be for the paper's worst t_comp at the paper's optimum.
"""

import argparse
import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from prefcal_env.mpc import Processor, TimedStep, fit_processor
from prefcal_scenarios.cases.overtake import overtake
from prefcal_scenarios.cases.overtake.computation_time import PAPER_T_COMP, t_comp
from prefcal_scenarios.cases.overtake.measuring import timed_steps

SHARES = (0.05, 0.25, 0.5, 0.75, 0.95)


def show(found: list[TimedStep], processor: Processor, console: Console) -> None:
    table = Table("variables", "rows", "steps", "iterations", "measured [µs]", "model [µs]")
    groups: dict[tuple[int, int], list[TimedStep]] = {}
    for step in found:
        groups.setdefault((step.size.variables, step.size.rows), []).append(step)
    for (n, m), group in sorted(groups.items()):
        iterations = np.array([s.iterations for s in group])
        model = processor.t_comp(group[0].size, iterations)
        measured = np.median([s.seconds for s in group]) * 1e6
        table.add_row(
            str(n), str(m), str(len(group)), f"{np.median(iterations):.0f}", f"{measured:.0f}",
            f"{np.median(model) * 1e6:.0f}",
        )  # fmt: skip
    console.print(table)
    ratio = [s.seconds / processor.t_comp(s.size, np.array([s.iterations]))[0] for s in found]
    q = np.quantile(ratio, SHARES)
    console.print("measured / model, 5 25 50 75 95 %:", " ".join(f"{v:.2f}" for v in q))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=15)
    rounds = parser.parse_args().rounds
    console = Console(markup=False)
    best = overtake.run(overtake.references["paper, preferences"])  # compiles
    found = timed_steps(
        rounds, lambda thetas: track(list(thetas), "timing", console=Console(stderr=True))
    )
    processor = fit_processor("this machine", found)
    show(found, processor, console)
    console.print(processor)
    here = t_comp(best, processor).max()
    console.print(
        f"At the paper's optimum {here * 1e6:.0f} µs at worst; "
        f"the paper's {PAPER_T_COMP} s are {PAPER_T_COMP / here:.0f} times that."
    )


if __name__ == "__main__":
    main()
