"""Show two runs in a terminal as a table: their KPIs, and θ."""

from collections.abc import Iterable, Mapping
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from prefcal_app.session import Question
from prefcal_app.view.sides import theta_view
from prefcal_env.knobs.space import KnobSpace
from prefcal_scenarios.presentation.wording import printable, with_unit

STYLES = {"left": "blue", "right": "dark_orange3"}


def show_kpis(
    rows: Iterable[Mapping[str, Any]], console: Console, names: Mapping[str, str]
) -> None:
    """Print the KPIs of two sides, as `comparison_view` returns them; the better one is bold.

    The title of each group, such as a maneuver, is on a line of its own.

    Args:
        rows: A row for each KPI.
        console: Where to print.
        names: Heading of each side, "left" and "right".
    """
    table = _table("KPI", names)
    table.add_column("right − left", justify="right")
    table.add_column("required")
    group = ""
    for row in rows:
        if row["group"] != group:
            group = row["group"]
            table.add_row(Text(printable(group), style="bold"))
        values = []
        for side in names:
            sign = {True: " ✓", False: " ✗", None: ""}[row[side]["met"]]
            text = with_unit(row[side]["text"], row["unit"]) + sign
            values.append(Text(text, style="bold" if row["better"] == side else ""))
        table.add_row(
            Text(printable(row["title"])), *values, row["difference"] or "–",
            Text(printable(row["objective"])),
        )  # fmt: skip
    console.print(table)


def show_theta(
    question: Question, space: KnobSpace, console: Console, names: Mapping[str, str]
) -> None:
    """Print θ of both sides; brackets, not only style, mark values that differ."""
    table = _table("θ", names)
    left, right = (side.experiment for side in (question.left, question.right))
    for knob, other in zip(
        theta_view(space, left, right), theta_view(space, right, left), strict=True
    ):
        values = [with_unit(each["text"], each["unit"]) for each in (knob, other)]
        texts = [
            Text(f"[{value}]", style="bold") if knob["differs"] else Text(value, style="dim")
            for value in values
        ]
        table.add_row(Text(printable(knob["name"])), *texts)
    console.print(table)


def _table(heading: str, names: Mapping[str, str]) -> Table:
    """Return a table without lines, so that it reads well aloud and through a pipe."""
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0))
    table.add_column(heading, overflow="fold")
    for side, name in names.items():
        table.add_column(Text(printable(name)), header_style=STYLES[side], justify="right")
    return table
