"""Calibrates the model of a step's computation time on this machine (prefcal_env.mpc.computation).

    OMP_NUM_THREADS=1 python benchmarks/computation.py [--rounds 15]

Every step of closed-loop runs of the car, over horizons small and large, is timed `rounds` times
and its shortest time kept. The four coefficients of a `Processor` are the non-negative
least-squares fit of the relative error. Prints them, how well they fit, and how much slower a
processor must be for the paper's worst t_comp at the paper's optimum.
"""

import argparse
import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy

import time

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table
from scipy.optimize import nnls

from prefcal_env.control import Controller, Measurement, Move
from prefcal_env.envs.overtake import OvertakeEnv
from prefcal_env.mpc.computation import Processor, StepSize
from prefcal_env.overtaking import Phase
from prefcal_env.plants.bicycle import Bicycle
from prefcal_env.rollout import rollout
from prefcal_scenarios.overtake import overtake
from prefcal_scenarios.overtake.computing import PAPER_T_COMP, t_comp
from prefcal_scenarios.overtake.scene import phase_at_control
from prefcal_scenarios.overtake.tuning import mpc_settings

THETAS = [
    (T_s, share, N_p, 0.261, 0.918)
    for T_s in (0.085, 0.4)
    for share in (0.1, 0.31, 0.65, 1.0)
    for N_p in (10, 16, 30)
]
Sample = tuple[StepSize, int, float]  # iterations, seconds


class Timed:
    """A controller that repeats every step on twins and keeps the shortest time."""

    def __init__(self, twins: list[Controller]) -> None:
        self.twins, self.T_s = twins, twins[0].T_s
        self.seconds: list[float] = []

    def move(self, measurement: Measurement) -> Move:
        """Decide as often as there are twins."""
        shortest = np.inf
        for twin in self.twins:
            start = time.perf_counter()
            move = twin.move(measurement)
            shortest = min(shortest, time.perf_counter() - start)
        self.seconds.append(shortest)
        return move


def samples(theta: np.ndarray, rounds: int) -> list[Sample]:
    """Size, iterations and seconds of every step of one run, the first few left out."""
    timed = Timed([overtake.controller(theta) for _ in range(rounds)])
    experiment = rollout(OvertakeEnv(), timed, theta)
    sizes = {p: StepSize.of(Bicycle(), mpc_settings(theta, p)) for p in Phase}
    steps = zip(phase_at_control(experiment), experiment.iterations, timed.seconds, strict=True)
    return [(sizes[Phase(p)], int(n), t) for p, n, t in steps][3:]


def fit(found: list[Sample]) -> Processor:
    """The processor whose times are nearest to the measured ones, relatively."""
    rows = [(1.0, n, s.building, n * s.iterating) for s, n, _ in found]
    seconds = np.array([t for *_, t in found])
    scale = np.array([1e-4, 1e-6, 1e-9, 1e-10])  # makes columns of about one size
    solution, _ = nnls(np.array(rows) * scale / seconds[:, None], np.ones(len(rows)))
    step, iteration, building, solving = (solution * scale).tolist()
    return Processor("this machine", step, iteration, 1 / building, 1 / solving)


def show(found: list[Sample], processor: Processor, console: Console) -> None:
    table = Table("variables", "rows", "steps", "iterations", "measured [µs]", "model [µs]")
    groups: dict[tuple[int, int], list[Sample]] = {}
    for sample in found:
        groups.setdefault((sample[0].variables, sample[0].rows), []).append(sample)
    for (n, m), group in sorted(groups.items()):
        iterations = np.array([i for _, i, _ in group])
        model = processor.t_comp(group[0][0], iterations)
        measured = np.median([t for *_, t in group]) * 1e6
        median = f"{np.median(iterations):.0f}"
        table.add_row(
            str(n), str(m), str(len(group)), median, f"{measured:.0f}",
            f"{np.median(model) * 1e6:.0f}",
        )  # fmt: skip
    console.print(table)
    ratio = [t / processor.t_comp(s, np.array([i]))[0] for s, i, t in found]
    q = np.percentile(ratio, [5, 25, 50, 75, 95])
    console.print("measured / model, 5 25 50 75 95 %:", " ".join(f"{v:.2f}" for v in q))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=15)
    rounds = parser.parse_args().rounds
    console = Console()
    found: list[Sample] = []
    for theta in track(THETAS, "timing", console=Console(stderr=True)):
        found += samples(np.array(theta), rounds)
    processor = fit(found)
    show(found, processor, console)
    console.print(processor)
    best = overtake.run(overtake.references["paper, preferences"])
    here = t_comp(best, processor).max()
    console.print(
        f"At the paper's optimum {here * 1e6:.0f} µs at worst; "
        f"the paper's {PAPER_T_COMP} s are {PAPER_T_COMP / here:.0f} times that."
    )


if __name__ == "__main__":
    main()
