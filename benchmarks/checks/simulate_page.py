"""Measure the example of docs/simulate.md: what its ten answers are worth, beside other agents.

Run `python benchmarks/checks/simulate_page.py` with the seeds 0 to 19; it takes some minutes.
"""

import argparse
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from prefcal_agents import GLISp, RandomSearch, minimize_by_preference

PAGE = Path(__file__).parents[2] / "docs" / "simulate.md"
FRESH = 1000
"""Number of random θ that each result is compared with."""


def example() -> dict[str, Any]:
    """Return the names that the first Python block of the page defines, without its study."""
    code = re.search(r"^```python\n(.*?)^found = ", PAGE.read_text(encoding="utf-8"), re.M | re.S)
    assert code is not None
    names: dict[str, Any] = {}
    exec(code.group(1), names)
    return names


def studies(names: dict[str, Any]) -> dict[str, Callable[[int], Any]]:
    """Return a study of a seed by its title."""
    prefer, space, simulate = names["prefer"], names["space"], names["simulate"]
    run = minimize_by_preference
    return {
        "Screening, 10 answers": lambda s: run(prefer, space, simulate=simulate, seed=s),
        "GLISp, 10 answers": lambda s: run(prefer, space, agent=GLISp, n_max=11, seed=s),
        "GLISp, 49 answers": lambda s: run(prefer, space, agent=GLISp, seed=s),
        "random search, 49 answers": lambda s: run(prefer, space, agent=RandomSearch, seed=s),
    }


def main(seeds: int) -> None:
    """Print the share of random θ that each study's result beats: lowest, median, highest."""
    names = example()
    rank, rng = names["priorities"], np.random.default_rng(99)
    n = len(names["space"])
    fresh = [rank(names["space"].decode(rng.random(n))) for _ in range(FRESH)]
    for title, study in studies(names).items():
        found = [rank(study(seed).best) for seed in range(seeds)]
        beaten = [np.mean([other > own for other in fresh]) for own in found]
        low, middle, high = np.percentile(beaten, [0, 50, 100])
        print(f"| {title} | {middle:.2%} | {low:.2%} | {high:.2%} |", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20, help="number of seeds")
    main(parser.parse_args().seeds)
