"""Drive random θ through varied traffic: every run must end with a reason and on time.

    OMP_NUM_THREADS=1 python benchmarks/checks/traffic.py [--samples 500] [--jobs 1]

Prints how the runs ended for each kind of traffic, as in docs/overtaking.md.
"""

import argparse
import sys
from collections import Counter
from collections.abc import Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from typing import Any

import numpy as np

from prefcal_env import Experiment
from prefcal_scenarios import load
from prefcal_scenarios.own.source import joined_source

QUEUE = {"count": 3, "types": ["idm", "braking"], "gap": [15, 50], "speed": [8, 12]}
CUTS_IN = {"count": 3, "types": ["cut-in", "constant"], "gap": [15, 50], "speed": [8, 12]}
COMES_TOWARD = {"count": 3, "types": ["oncoming", "idm"], "gap": [20, 80], "speed": [8, 14]}
TRAFFIC: Mapping[str, Mapping[str, Any]] = {
    "a queue that keeps its distance": {"traffic": [], "random_traffic": QUEUE},
    "three lanes, from which others cut in": {"lanes_count": 3, "random_traffic": CUTS_IN},
    "a two-way road": {
        "lanes_count": 1, "oncoming_lanes_count": 1, "random_traffic": COMES_TOWARD,
    },
}  # fmt: skip
"""Configurations, each drawn anew for every θ."""


def drive(name: str, i: int) -> Experiment:
    """Run random θ number `i` in the traffic called `name`."""
    scenario = load(joined_source("overtake", TRAFFIC[name]))
    theta = scenario.space.decode(np.random.default_rng([1, i]).random(len(scenario.space)))
    return scenario.run(theta, seed=i)


def complaints(e: Experiment) -> Iterator[str]:
    """Yield what is wrong with an experiment."""
    T_s = float(e.theta[0])
    n = len(e.t_control)
    if not np.allclose(e.t_control, np.arange(n) * T_s, rtol=0, atol=1e-9):
        yield "sampling instants are not k T_s to 1e-9 s"
    if not e.end.interrupted and abs(e.t[-1] - n * T_s) > 1e-9:
        yield "it does not end at a sampling instant"
    if not e.end.interrupted and not 15 - 1e-9 <= e.t[-1] < 15 + T_s:
        yield f"it ends at {e.t[-1]} s"
    if np.any(np.diff(e.t) <= 0):
        yield "time does not increase"
    arrays = {"x": e.x, "u": e.u, **e.signals}
    arrays.pop("lateral_distance")  # NaN where nobody is alongside
    for what, values in arrays.items():
        if not np.isfinite(values).all():
            yield f"{what} is not finite"
    yield from (f"KPI {k} is NaN" for k, v in e.kpis.items() if np.isnan(v))


def ending(e: Experiment) -> str:
    """Return why the run ended."""
    if not e.end.interrupted:
        return "time is up"
    if e.kpis["collision"]:
        return "collision"
    return "off the road" if e.kpis["off_road"] > 1 else f"unknown: {e.end}"


def judged(name: str, i: int) -> tuple[str, list[str]]:
    """Return how run `i` ended, and what is wrong with it."""
    e = drive(name, i)
    return ending(e), list(complaints(e))


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--samples", type=int, default=500, help="θ in each traffic")
    parser.add_argument("--jobs", type=int, default=1)
    options = parser.parse_args()
    wrong = 0
    print(
        "| traffic | time is up | collision | off the road | wrong |\n"
        "| --- | --- | --- | --- | --- |"
    )
    for name in TRAFFIC:
        with ProcessPoolExecutor(options.jobs) as pool:
            found = list(pool.map(partial(judged, name), range(options.samples), chunksize=10))
        ends = Counter(end for end, _ in found)
        bad = [(i, says) for i, (_, says) in enumerate(found) if says]
        unknown = sum(ends.values()) - ends["time is up"] - ends["collision"] - ends["off the road"]
        wrong += len(bad) + unknown
        cells = [name, ends["time is up"], ends["collision"], ends["off the road"], len(bad)]
        print(f"| {' | '.join(map(str, cells))} |", flush=True)
        for i, says in bad[:5]:
            print(f"θ number {i}: {says}", file=sys.stderr)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
