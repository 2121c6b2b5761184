"""Search the box of the CSTR for the smallest performance index, N_p by N_p.

    python benchmarks/checks/best_known.py [--runs runs.csv] [--coarse 24]

Writes `reactor_index.csv` beside it: for every prediction horizon the smallest index of all, and
the smallest one of a run that does not undershoot the accepted band. `prefcal bench` measures gaps
from the second one; docs/gallery/reactor.md explains why there are two. With `--runs` every
experiment is kept, and the same command resumes.

The index has a crease: where a run that overshot the target ends on it by chance, the final error
vanishes, and a grid steps over it. So each line of the grid is also searched where the final error
changes its sign. After the grid, Nelder-Mead starts for each N_p from its best or a neighbor's.
Nothing is random. It runs about 6,000 experiments in seven minutes on one core.
"""

import argparse
import csv
from collections.abc import Callable
from dataclasses import astuple, dataclass, fields
from itertools import pairwise
from pathlib import Path

import numpy as np
from rich.console import Console
from scipy.optimize import brentq, minimize

from prefcal_env.envs.cstr import BAND, TARGET
from prefcal_scenarios import load

TABLE = Path(__file__).parent / "reactor_index.csv"
PERIODS = (0.25, 0.27, 0.3, 0.35, 0.42, 0.52, 0.7, 1.0, 1.4)
"""Lines of the grid, T_s in h: closer where the index is low."""
SHORT, LONG = tuple(range(4, 14)), (14, 17, 20, 25, 30, 35, 40)
"""N_p of the grid: every one where the index changes a lot. Nelder-Mead visits the others, too."""


@dataclass(frozen=True, order=True)
class Run:
    """Results of an experiment; the index is first, so that the smallest one is the best."""

    index: float
    T_s: float
    N_p: int
    log_Q: float
    final_error: float
    undershoot: float
    settled_at: float
    mean_square_move: float

    @property
    def calm(self) -> bool:
        """Return whether C_A stays above the lower end of the accepted band."""
        return self.undershoot <= BAND


class Search:
    """Search that runs each θ once and keeps all runs."""

    def __init__(self, kept: Path | None) -> None:
        self.scenario, self.kept = load("cstr"), kept
        self.runs: dict[tuple[float, int, float], Run] = {}
        for row in csv.reader(kept.open()) if kept and kept.exists() else ():
            values = dict(zip((f.name for f in fields(Run)), map(float, row), strict=True))
            self._add(Run(**values | {"N_p": int(values["N_p"])}))

    def _add(self, run: Run) -> None:
        self.runs[run.T_s, run.N_p, run.log_Q] = run

    def __call__(self, T_s: float, N_p: int, log_Q: float) -> Run:
        """Return the run of the θ nearest to these values."""
        low, high = np.array([(k.low, k.high) for k in self.scenario.space.knobs]).T
        # Seven digits can be dialed in, and read the same in the file.
        theta = np.round(np.clip([T_s, N_p, log_Q], low, high), 7)
        key = (float(theta[0]), int(theta[1]), float(theta[2]))
        if key not in self.runs:
            experiment = self.scenario.run(theta)
            kpis = experiment.kpis
            run = Run(
                self.scenario.cost(experiment), *key, kpis["final_concentration"] - TARGET,
                kpis["undershoot"], kpis["settling_time"], kpis["mean_square_move"],
            )  # fmt: skip
            self._add(run)
            if self.kept:
                with self.kept.open("a", newline="") as file:
                    csv.writer(file).writerow(astuple(run))
        return self.runs[key]

    def best(self, N_p: int | None = None, calm: bool = False) -> Run:
        """Return the run with the smallest index."""
        return min(r for r in self.runs.values() if N_p in (None, r.N_p) and (r.calm or not calm))


def line(search: Search, T_s: float, N_p: int, coarse: int) -> None:
    """Search a line of the grid, and the points on it where the final error changes its sign."""
    points = [search(T_s, N_p, q) for q in np.linspace(-5, 3, coarse + 1)]
    for a, b in pairwise(points):
        if a.index < 1000 and b.index < 1000 and a.final_error * b.final_error < 0:
            cross(search, T_s, N_p, (a.log_Q, b.log_Q))


def cross(search: Search, T_s: float, N_p: int, between: tuple[float, float]) -> Run:
    """Return the run between two values of log Q at which the final error vanishes, to 1e-3."""
    found = brentq(
        lambda q: search(T_s, N_p, q).final_error, *between, xtol=1e-3, maxiter=12, disp=False
    )
    return search(T_s, N_p, found)


def refine(search: Search, start: Run, N_p: int, calm: bool, budget: int = 16) -> None:
    """Refine (T_s, log Q) by Nelder-Mead; with `calm`, runs that are not calm are excluded."""

    def index(z: np.ndarray) -> float:
        run = search(z[0], N_p, z[1])
        return run.index + 10.0 * (calm and not run.calm)

    corner = np.array([start.T_s, start.log_Q])
    away = np.array([0.006 if start.T_s < 1.49 else -0.006, 0.03])
    simplex = corner + np.array([[0, 0], [away[0], away[1]], [0, -away[1]]])
    minimize(index, corner, method="Nelder-Mead",
             options={"maxfev": budget, "initial_simplex": simplex, "xatol": 1e-6})  # fmt: skip


def start(search: Search, N_p: int, calm: bool) -> Run:
    """Return the best run of this N_p or of its neighbors."""
    near = [r for r in search.runs.values() if abs(r.N_p - N_p) <= 1 and (r.calm or not calm)]
    return min(near)


def search_box(search: Search, coarse: int, say: Callable[[str], None]) -> None:
    """Search the grid with its creases, then refine by Nelder-Mead for every horizon."""
    for N_p in (*SHORT, *LONG):
        for T_s in PERIODS if N_p in SHORT else PERIODS[::3]:
            line(search, T_s, N_p, coarse)
        say(f"N_p {N_p}: {search.best(N_p)}")
    for calm in (True, False):
        for N_p in range(4, 41):
            if calm or not search.best(N_p).calm:
                refine(search, start(search, N_p, calm), N_p, calm)
            say(f"refined N_p {N_p}: {search.best(N_p, calm)}")
        for _ in range(3):  # a fresh simplex gets over jumps of the index
            best = search.best(calm=calm)
            refine(search, best, best.N_p, calm, 60)
        say(f"{'calm' if calm else 'all'}: {search.best(calm=calm)}")


def write(search: Search, path: Path) -> None:
    """Write a row for each N_p and kind: all runs, and the calm ones."""
    with path.open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["runs", *(f.name for f in fields(Run))])
        for kind in ("calm", "all"):
            for N_p in range(4, 41):
                best = search.best(N_p, kind == "calm")
                writer.writerow([kind, *(f"{v:.8g}" for v in astuple(best))])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=Path, help="file to keep every experiment in")
    parser.add_argument("--coarse", type=int, default=24, help="steps of log Q on a line")
    options = parser.parse_args()
    console, search = Console(soft_wrap=True), Search(options.runs)
    search_box(search, options.coarse, lambda words: console.print(words, highlight=False))
    write(search, TABLE)
    console.print(f"{len(search.runs)} experiments; {TABLE}")


if __name__ == "__main__":
    main()
