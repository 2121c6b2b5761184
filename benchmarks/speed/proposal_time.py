"""Time one proposal of GLISp: 50, 400 and 1,000 samples, without and with KPIs.

    python benchmarks/speed/proposal_time.py  # a few minutes
    python benchmarks/speed/proposal_time.py --samples 50 --functions hartman3

Prints a Markdown table: processor time in milliseconds, median and worst of the proposals after
that number of samples, and as a multiple of a fixed piece of linear algebra timed in between, since
machines differ. No complete study is run: the samples are random, and each is compared with the
best before it.
"""

import argparse
import time
from collections.abc import Sequence

import numpy as np
from rich.console import Console
from rich.progress import track

from prefcal_agents import GLISp
from prefcal_agents.agent import one_thread
from prefcal_bench.problems.functions import FUNCTIONS
from prefcal_bench.results.words import markdown
from prefcal_env import Answer

REPEATS = 12  # validations and noise tests come once in ten
KPIS = 8


def agent_after(name: str, count: int, *, kpis: bool, seed: int) -> GLISp:
    """Return an agent that has learned from `count` random samples."""
    function, rng = FUNCTIONS[name], np.random.default_rng(seed)
    space = function.space
    weights = rng.standard_normal((KPIS, len(space)))

    def outcome(theta: np.ndarray) -> dict[str, float]:
        z = space.encode(theta)
        found = {f"KPI {k}": float(np.sin(3 * w @ z)) for k, w in enumerate(weights)}
        return {**found, "cost": function(theta)}

    agent = GLISp(space, n_init=count, n_max=count + REPEATS + 1, seed=seed)
    for _ in range(count):
        query = agent.ask()
        new, old = query.challenger.theta, query.incumbent
        verdict = None if old is None else function.prefer(new, old.theta)
        pair = (outcome(new), None if old is None else outcome(old.theta)) if kpis else None
        agent.tell(query, Answer(verdict, outcomes=pair))
    return agent


def yardstick() -> float:
    """Return the processor time of a fixed piece of linear algebra, in ms."""
    a = np.eye(300) + 1 / (1 + np.arange(300)[:, None] + np.arange(300))
    start = time.process_time()
    for _ in range(10):
        np.linalg.inv(a)
    return 1e3 * (time.process_time() - start)


def times(name: str, count: int, *, kpis: bool) -> tuple[list[float], list[float]]:
    """Return the ms of each proposal, and of the yardstick timed with it."""
    agent, found, beside = agent_after(name, count, kpis=kpis, seed=0), [], []
    for _ in range(REPEATS):
        beside.append(yardstick())
        start = time.process_time()
        query = agent.ask()
        found.append(1e3 * (time.process_time() - start))
        agent.tell(query, 1)
    return found[1:], beside[1:]  # the first looks at every earlier answer once


def table(rows: Sequence[tuple[str, int, bool]]) -> str:
    """Return Markdown of all `rows`: function, samples, whether KPIs are used."""
    lines = []
    for name, count, kpis in track(rows, "timing", console=Console(stderr=True)):
        found, beside = times(name, count, kpis=kpis)
        numbers = f"{np.median(found):.0f}", f"{max(found):.0f}"
        ratio = f"{np.median(np.divide(found, beside)):.2f}"
        lines.append([name, count, KPIS + 1 if kpis else "none", *numbers, ratio])
    head = ["function", "samples", "KPIs", "median ms", "worst ms", "times the yardstick"]
    return "\n".join(markdown(head, lines))


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--samples", type=int, nargs="+", default=[50, 400, 1000])
    parser.add_argument("--functions", nargs="+", default=["camel", "hartman3", "hartman6"])
    args = parser.parse_args()
    rows = [(f, n, k) for f in args.functions for n in args.samples for k in (False, True)]
    with one_thread():  # of two the second would wait, busily, during a proposal
        print(table(rows))


if __name__ == "__main__":
    main()
