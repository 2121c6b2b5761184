"""The end of a benchmark, for people."""

from collections.abc import Mapping
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from prefcal_scenarios.bench import Finished
from prefcal_scenarios.bench.presenting import Presented
from prefcal_scenarios.report.wording import printable


def show(finished: Finished, presented: Presented, console: Console) -> None:
    """Print the table, what failed, the digest, and where the page is."""
    with_cost = [row for row in presented.rows if row["gap_median"] is not None]
    if with_cost:
        console.print(_gaps(with_cost))
    if presented.duels:
        console.print(_duels(presented.duels))
    for words in (*(f"{r.cell} failed: {r.failure}" for r in finished.failures), *finished.trouble):
        console.print(Text(printable(words), style="red"), soft_wrap=True)
    console.print(Text.assemble("Digest: ", (finished.digest, "bold")), soft_wrap=True)
    if presented.page is not None:
        console.print(Text.assemble("Page: ", (str(presented.page), "bold")), soft_wrap=True)


def _gaps(rows: list[Mapping[str, Any]]) -> Table:
    table = Table(title="Gap to the best known value", title_style="bold", title_justify="left")
    for heading in ("problem", "calibrator", "agent"):
        table.add_column(heading, overflow="fold")
    timed = any(row["seconds_per_proposal"] is not None for row in rows)
    for heading in ("seeds", "median", "quartiles", *(["ms/proposal"] if timed else [])):
        table.add_column(heading, justify="right")
    for before, row in zip([None, *rows], rows, strict=False):
        if before is not None and _place(before) != _place(row):
            table.add_section()
        seconds = row["seconds_per_proposal"]
        cells = [
            row["problem"], row["calibrator"], printable(row["agent"]), str(row["seeds"]),
            f"{row['gap_median']:.2g}",
            f"{row['gap_lower_quartile']:.2g} to {row['gap_upper_quartile']:.2g}",
        ]  # fmt: skip
        if timed:
            cells.append("" if seconds is None else f"{1e3 * seconds:.1f}")
        table.add_row(*map(Text, cells))
    return table


def _place(row: Mapping[str, Any]) -> tuple[Any, Any]:
    return row["problem"], row["calibrator"]


def _duels(rows: list[Mapping[str, Any]]) -> Table:
    table = Table(title="Whose θ is preferred", title_style="bold", title_justify="left")
    for heading in ("problem", "calibrator", "agent", "against"):
        table.add_column(heading, overflow="fold")
    for heading in ("seeds", "wins", "ties", "losses"):
        table.add_column(heading, justify="right")
    for row in rows:
        names = [row["problem"], row["calibrator"], row["agent"], row["rival"]]
        counts = [str(row[name]) for name in ("seeds", "wins", "ties", "losses")]
        table.add_row(*(Text(printable(cell)) for cell in (*names, *counts)))
    return table
