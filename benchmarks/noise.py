"""People err: what wrong answers cost a GLISp that reckons with them, and one that does not.

    python benchmarks/noise.py [--problems camel hartman3] [--seeds 10] [--first 0] [--rates 0.1 0]

Each study has 50 experiments, 10 of them initial, and one comparison each; a share of the answers
is wrong, and the same pair would be answered the same again. Median gaps of the returned θ, how
many times that of the calibrator who never errs, and in brackets the best θ that was visited.
"""

import argparse
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from prefcal_agents import GLISp, GLISpSettings
from prefcal_agents.threads import one_thread
from prefcal_scenarios.bench.judges import Outcome
from prefcal_scenarios.bench.problems import NOISES, PROBLEMS, problem

N_INIT, N_MAX = 10, 50
CALIBRATORS = ("perfect", *NOISES)


class Gaps(NamedTuple):
    """Of the θ that was returned, and of the best one visited."""

    returned: float
    visited: float


def run(name: str, calibrator: str, seed: int, error_rate: float) -> Gaps:
    """One study."""
    where = problem(name)
    judge = where.calibrators[calibrator](seed)
    settings = GLISpSettings(error_rate=error_rate)
    agent = GLISp(where.space, n_init=N_INIT, n_max=N_MAX, seed=seed, settings=settings)
    tried: list[Outcome] = []
    while not agent.done:
        query = agent.ask()
        tried.append(where.outcome(query.challenger.theta))
        rival = query.incumbent
        agent.tell(query, None if rival is None else judge.prefer(tried[-1], tried[rival.index]))
    gaps = [where.gap(outcome) for outcome in tried]
    return Gaps(where.gap(where.outcome(agent.best)), min(gaps))


def cells(found: dict[str, list[Gaps]]) -> Iterator[str]:
    """Medians of one row, and how many times the first."""
    first = None
    for gaps in found.values():
        returned, visited = np.median(np.array(gaps), axis=0)
        first = returned if first is None else first
        yield f"{returned:.2g} ({visited:.1g})"
        if gaps is not next(iter(found.values())):
            yield f"{returned / first:.2g}" if first > 0 else "-"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    functions = [name for name in PROBLEMS if problem(name).has_cost and name != "cstr"]
    parser.add_argument("--problems", nargs="+", default=functions, choices=functions)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--rates", type=float, nargs="+", default=[0.1, 0.0])
    options = parser.parse_args()
    seeds = range(options.first, options.first + options.seeds)
    table = Table("problem", "error_rate", "perfect", "noisy10", "times", "noisy20", "times")
    rows = [(name, rate) for name in options.problems for rate in options.rates]
    found: dict[tuple[str, float], dict[str, list[Gaps]]] = {
        row: {calibrator: [] for calibrator in CALIBRATORS} for row in rows
    }
    tasks = [(row, calibrator, s) for row in rows for calibrator in CALIBRATORS for s in seeds]
    with one_thread():
        for (name, rate), calibrator, seed in track(tasks, console=Console(stderr=True)):
            found[name, rate][calibrator].append(run(name, calibrator, seed, rate))
    for name, rate in rows:
        table.add_row(name, f"{rate:g}", *cells(found[name, rate]))
    Console(width=120).print(table)


if __name__ == "__main__":
    main()
