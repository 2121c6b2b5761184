"""Print the table of docs/benchmarks.md about closed loops, from the published studies.

    python benchmarks/campaigns/worth_table.py

`prefcal bench --problems ... --calibrators weights,priorities` computes the studies themselves.
"""

from typing import Any

from prefcal_bench.published.plan import read_published
from prefcal_bench.results import campaign_of, worth_table
from prefcal_bench.results.rows import BASELINE
from prefcal_bench.results.words import markdown, with_interval

Row = dict[str, Any]
TASTES = ("weights", "priorities")


def lines() -> list[str]:
    """Return the lines of the table: an agent a row, the worth after 20 and 50 experiments."""
    rows = worth_table(campaign_of((), read_published()), BASELINE)
    found = {(r["agent"], r["taste"], r["after"]): r for r in rows if r["unit"] == "experiments"}
    agents = dict.fromkeys(r["agent"] for r in rows)
    ends = sorted({r["after"] for r in rows if r["unit"] == "experiments"})
    heads = [f"{taste}, {n}" for taste in TASTES for n in ends]
    columns = ["agent", "seeds", "answers", *heads, "beats GLISp", "drift"]
    order = sorted(agents, key=lambda a: -max(_worth(found, a, t, ends[-1]) for t in TASTES))
    cells = []
    for agent in order:
        last = [found.get((agent, taste, ends[-1])) for taste in TASTES]
        there = [row for row in last if row is not None]
        cells.append(
            [
                agent,
                f"{max(row['studies'] // row['loops'] for row in there)}",
                f"{sum(row['answers'] for row in there) / len(there):.0f}",
                *(_worths(found.get((agent, taste, n))) for taste in TASTES for n in ends),
                ", ".join(_share(row) for row in last),
                ", ".join("–" if row is None else f"{row['drift']:.1f}" for row in last),
            ]
        )
    return markdown(columns, cells)


def _worth(found: dict[tuple[str, str, int], Row], agent: str, taste: str, after: int) -> float:
    row = found.get((agent, taste, after))
    return 0.0 if row is None else float(row["worth"])


def _worths(row: Row | None) -> str:
    found = (None, None, None) if row is None else (row["worth"], row["worth_low"], row["worth_high"])
    return with_interval(*found, "{:.0f}".format)


def _share(row: Row | None) -> str:
    if row is None or row["improvement"] is None:
        return "–"
    return f"{100 * row['improvement']:.0f} %"


if __name__ == "__main__":
    print("\n".join(lines()))
