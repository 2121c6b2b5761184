"""Check generated closed loops and their tastes: do experiments end well, and is tuning a task?

    python benchmarks/checks/generated_loops.py --first 7000 --count 20
    python benchmarks/checks/generated_loops.py --family rough --first 7000 --count 20

For each loop it runs random θ and asks ten people with each taste. It prints what random search is
worth to them after 50 experiments, how often the first priority decides a random pair, and how many
θ fail. It exits with 1 if an experiment raises or gives NaN, or if a number is outside its range.
"""

import argparse
import os
import sys

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy

import numpy as np
from rich.console import Console
from rich.progress import track

from prefcal_bench.people import USUAL, random_search_worth, sample, taste
from prefcal_bench.people.draw import decided
from prefcal_bench.people.judgements import Order
from prefcal_env.experiments.experiment import End
from prefcal_scenarios import Scenario, load

TASTES = ("weights", "priorities")
PEOPLE = 10
WORTH = (40.0, 110.0)  # accepted worth of random search after 50 experiments: 90 if any two runs differ
DECIDED = (0.05, 0.6)  # accepted share of random pairs that the first priority decides
FAILED = {"loop": (0.0, 0.85), "rough": (0.03, 0.45)}  # accepted share of random θ that fail, by family


def examine(name: str) -> tuple[bool, str, list[str]]:
    """Return whether the loop called `name` fits, a line of its numbers, and faults of experiments."""
    scenario = load(name)
    usual, pool, tried = (sample(scenario, part) for part in (USUAL, "pool", "search"))
    worth, shares = {}, []
    for kind in TASTES:
        logs = []
        for person in range(PEOPLE):
            rule = taste(kind, scenario.kpis, usual, person).rule
            rng = np.random.default_rng(person)
            value = random_search_worth(rule, tried, experiments=50, replays=200, rng=rng, pool=pool)
            logs.append(np.log(value))
            if isinstance(order := getattr(rule, "by", None), Order):
                pairs = (pool.take(rows) for rows in rng.integers(len(pool), size=(2, 4000)))
                shares.append(decided(order.criteria[0], *pairs))
        worth[kind] = float(np.exp(np.mean(logs)))
    failed, low, high = float(np.mean(np.isfinite(pool.survived))), min(shares), max(shares)
    few, many = FAILED[name.partition("-")[0]]
    fits = few <= failed <= many and DECIDED[0] <= low and high <= DECIDED[1]
    fits = fits and all(WORTH[0] <= value <= WORTH[1] for value in worth.values())
    worths = ", ".join(f"{kind} {value:.0f}" for kind, value in worth.items())
    line = (
        f"{name}: {worths}; first priority decides {low:.0%} to {high:.0%} of pairs; "
        f"{failed:.0%} of θ fail; {scenario.title}"
    )
    found = faults(scenario)
    return fits and not found, line, found


def faults(scenario: Scenario, count: int = 40) -> list[str]:
    """Return what is wrong with `count` random experiments: NaN, or no reason for the end."""
    rng, found = np.random.default_rng(1), []
    for _ in range(count):
        run = scenario.run(scenario.space.decode(rng.random(len(scenario.space))), seed=2)
        if any(np.isnan(value) for value in run.kpis.values()):
            found.append(f"NaN at θ = {run.theta}")
        if not (np.isfinite(run.x).all() and np.isfinite(run.u).all()):
            found.append(f"a curve is not finite at θ = {run.theta}")
        if not isinstance(run.end, End):
            found.append(f"no reason for the end at θ = {run.theta}")
    return found


def main() -> int:
    """Examine the loops and print a line for each; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--family", choices=sorted(FAILED), default="loop")
    parser.add_argument("--first", type=int, default=7000, help="first seed")
    parser.add_argument("--count", type=int, default=20, help="number of loops")
    options = parser.parse_args()
    console, bad = Console(), 0
    seeds = range(options.first, options.first + options.count)
    for seed in track(seeds, "loops", console=Console(stderr=True)):
        fits, line, found = examine(f"{options.family}-{seed}")
        bad += not fits
        console.print(f"{'ok ' if fits else 'BAD'} {line}", soft_wrap=True)
        for words in found:
            console.print(f"    {words}", soft_wrap=True)
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
