"""Measure the example of docs/simulate.md: what its ten answers are worth, beside other agents.

Run `python benchmarks/checks/simulate_page.py` with the seeds 0 to 19; it takes some minutes.
"""

import argparse
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from prefcal_agents import GLISp, RandomSearch, minimize_by_preference

PAGE = Path(__file__).parents[2] / "docs" / "simulate.md"
FRESH = 1000  # number of random θ that each result is compared with


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


def beaten(names: dict[str, Any], found: Sequence[Any]) -> list[float]:
    """Return the share of random θ that are worse than the result of each study."""
    rank, space, rng = names["priorities"], names["space"], np.random.default_rng(99)
    fresh = [rank(space.decode(rng.random(len(space)))) for _ in range(FRESH)]
    return [float(np.mean([other > rank(study.best) for other in fresh])) for study in found]


def main(seeds: int) -> None:
    """Print the rows of the page's table: median, lowest and highest share of all seeds."""
    names = example()
    for title, study in studies(names).items():
        shares = beaten(names, [study(seed) for seed in range(seeds)])
        middle, low, high = np.percentile(shares, [50, 0, 100])
        print(f"| {title} | {middle:.1%} | {low:.1%} | {high:.1%} |", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20, help="number of seeds")
    main(parser.parse_args().seeds)
