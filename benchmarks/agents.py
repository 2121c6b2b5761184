"""How near the agents come to the optimum of latent functions, and how fast they propose.

    python benchmarks/agents.py [--quick] [--jobs 2] [--functions camel,hartman3]

Prints, for each function and agent, the quartiles over the seeds of the gap to the optimum
after 50 experiments (10 initial), and the time that a proposal takes at 50 samples. The package
`glis` is measured beside them on request (--agents GLISp,glis), where it is installed and runs.
"""

import argparse
import importlib.util
import os
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, as_completed
from functools import partial

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy: one study is one thread

import numpy as np
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from prefcal_agents import GLISp, LatinHypercube, RandomSearch
from prefcal_scenarios.functions import FUNCTIONS, TestFunction

N_INIT, N_MAX = 10, 50
Result = tuple[float, float]  # gap, seconds of a proposal at the end


def run_ours(make: Callable, function: TestFunction, seed: int) -> Result:
    agent = make(function.space, n_init=N_INIT, n_max=N_MAX, seed=seed)
    seconds = []
    while not agent.done:
        start = time.perf_counter()
        query = agent.ask()
        seconds.append(time.perf_counter() - start)
        rival = query.incumbent
        agent.tell(query, rival and function.prefer(query.challenger.theta, rival.theta))
    return function.gap(agent.best), float(np.median(seconds[-5:]))


def run_reference(function: TestFunction, seed: int) -> Result:
    from glis.solvers import GLISp as Reference

    np.random.seed(seed)  # noqa: NPY002 - it takes no generator
    low = np.array([k.low for k in function.space])
    high = np.array([k.high for k in function.space])
    solver = Reference(bounds=(low, high), n_initial_random=N_INIT, display=0)
    start = time.perf_counter()
    best = solver.solve(function.prefer, N_MAX - 1)
    seconds = (time.perf_counter() - start) / (N_MAX - N_INIT)
    return function.gap(np.clip(best, low, high)), seconds


RUNNERS: dict[str, Callable[[TestFunction, int], Result]] = {
    "GLISp": partial(run_ours, GLISp),
    "GLISp.paper": partial(run_ours, GLISp.paper),
    "RandomSearch": partial(run_ours, RandomSearch),
    "LatinHypercube": partial(run_ours, LatinHypercube),
}
OURS = tuple(RUNNERS)
if importlib.util.find_spec("glis"):
    RUNNERS["glis"] = run_reference


def run(job: tuple[str, str, int]) -> tuple[tuple[str, str, int], Result]:
    function, agent, seed = job
    return job, RUNNERS[agent](FUNCTIONS[function], seed)


def show(results: dict[tuple[str, str, int], Result]) -> None:
    table = Table("function", "knobs", "agent", "median gap", "quartiles", "ms/proposal", "seeds")
    for column in table.columns[3:]:
        column.justify = "right"
    for function, agent in dict.fromkeys((f, a) for f, a, _ in sorted(results)):
        rows = np.array([r for (f, a, _), r in results.items() if (f, a) == (function, agent)])
        low, median, high = np.quantile(rows[:, 0], [0.25, 0.5, 0.75])
        cells = (
            f"{median:.2g}",
            f"{low:.2g} to {high:.2g}",
            f"{1e3 * np.median(rows[:, 1]):.1f}",
        )
        knobs = str(len(FUNCTIONS[function].space))
        table.add_row(function, knobs, agent, *cells, str(len(rows)))
    Console(width=110).print(table)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="4 seeds and 3 functions")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--functions", help=f"comma-separated, of {', '.join(FUNCTIONS)}")
    parser.add_argument("--agents", default=",".join(OURS), help=f"of {', '.join(RUNNERS)}")
    options = parser.parse_args()
    names = ["camel", "hartman3", "terraces3"] if options.quick else list(FUNCTIONS)
    names = options.functions.split(",") if options.functions else names
    agents = options.agents.split(",")
    for given, known in ((names, FUNCTIONS), (agents, RUNNERS)):
        if unknown := [name for name in given if name not in known]:
            parser.error(f"unknown: {', '.join(unknown)}; known: {', '.join(known)}")
    seeds = 4 if options.quick else options.seeds
    jobs = [(f, a, s) for f in names for a in agents for s in range(seeds)]
    results = {}
    with ProcessPoolExecutor(options.jobs) as pool, Progress(transient=True) as progress:
        bar = progress.add_task("studies", total=len(jobs))
        for future in as_completed([pool.submit(run, job) for job in jobs]):
            job, result = future.result()
            results[job] = result
            progress.update(bar, advance=1, description=f"{job[1]} on {job[0]}")
    show(results)


if __name__ == "__main__":
    main()
