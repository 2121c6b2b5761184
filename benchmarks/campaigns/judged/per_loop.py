"""Tell on which loops an agent is worth more or less than another, from results of `prefcal bench`.

    python benchmarks/campaigns/judged/per_loop.py results/raw.parquet --agents GLISp RandomSearch

Prints a Markdown table with a row for each taste and loop: worth at the end of both agents, and
their ratio with a 95 % interval over the seeds (Student's t, on logarithms, seeds paired).
"""

import argparse
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.stats import t as student

from prefcal_bench.results.paired import interval, markdown
from prefcal_bench.results.statistics import Estimate


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("raw", type=Path, help="raw.parquet in the folder of results")
    parser.add_argument("--agents", nargs=2, default=["GLISp", "RandomSearch"], metavar="NAME")
    options = parser.parse_args()
    raw = pd.read_parquet(options.raw)
    print("\n".join(table(raw, *options.agents)))


def table(raw: pd.DataFrame, one: str, other: str) -> list[str]:
    """Return the lines of the table."""
    keys, rows = ["taste", "loop", "seed"], []
    ends = raw.sort_values("after").groupby(["agent", *keys]).worth.last().unstack("agent")
    for (taste, loop), both in ends[[one, other]].dropna().groupby(["taste", "loop"]):
        logs = np.log(both)
        ours, theirs = np.exp(logs.mean())
        low, high = ratio((logs[one] - logs[other]).to_numpy())
        word = "below" if high < 1 else "above" if low > 1 else ""
        found = interval(Estimate(ours / theirs, low, high), 2)
        rows.append([taste, loop, len(both), f"{ours:.0f}", f"{theirs:.0f}", found, word])
    return markdown(["taste", "loop", "seeds", one, other, "ratio", ""], rows)


def ratio(differences: np.ndarray) -> tuple[float, float]:
    """Return the ends of the 95 % interval of exp(mean); infinite with a single difference."""
    count = len(differences)
    if count < 2:
        return 0.0, float("inf")
    wide = student.ppf(0.975, count - 1) * differences.std(ddof=1) / np.sqrt(count)
    low, high = np.exp(differences.mean() + np.array([-wide, wide]))
    return float(low), float(high)


if __name__ == "__main__":
    main()
