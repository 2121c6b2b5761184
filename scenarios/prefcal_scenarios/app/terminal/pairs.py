"""Show two runs in a terminal, without a study, and the KPIs of any two runs."""

from collections.abc import Iterable, Mapping
from typing import Any

from rich.console import Console
from rich.panel import Panel as Box
from rich.table import Table
from rich.text import Text

from prefcal_env.experiments.experiment import Experiment
from prefcal_env.experiments.maneuvers import maneuvers_of
from prefcal_env.experiments.panels import Plot
from prefcal_scenarios.app.presentation.wording import printable, with_unit
from prefcal_scenarios.app.web.view import Seen

from .drawing import curves
from .showing import STYLES, WIDE, show_boxes


def show_runs(
    sides: Mapping[str, tuple[str, Experiment]],
    panels: tuple[Plot, ...],
    rows: Iterable[Mapping[str, Any]],
    console: Console,
) -> None:
    """Print the curves of both runs, next to each other if there is room, and their KPIs.

    Args:
        sides: Name and experiment of each side, "left" and "right".
        panels: Panels of both.
        rows: Their KPIs, as `comparison_view` returns them.
        console: Where to print.
    """
    width = (console.width // 2 if console.width >= WIDE else console.width) - 6
    parts = maneuvers_of(*(experiment for _, experiment in sides.values()))
    for maneuver, runs in parts.items():
        if maneuver:
            console.print(f"Maneuver {printable(maneuver)}", markup=False, highlight=False)
        axes = Seen().frame(panels, *runs)
        show_boxes([
            Box(curves(run, panels, axes, width=width, style=STYLES[side]),
                title=Text(printable(name)), title_align="left", border_style=STYLES[side])
            for (side, (name, _)), run in zip(sides.items(), runs, strict=True)
        ], console)  # fmt: skip
    show_rows(rows, console)


def show_rows(rows: Iterable[Mapping[str, Any]], console: Console) -> None:
    """Print the KPIs of two sides, as `comparison_view` returns them; the better one is bold.

    The title of each group, such as a maneuver, is on a line of its own.
    """
    table = Table(title_justify="left", expand=False)
    for heading, style in (("KPI", ""), ("LEFT", STYLES["left"]), ("RIGHT", STYLES["right"])):
        table.add_column(heading, header_style=style, justify="right" if style else "left")
    table.add_column("right − left", justify="right")
    group = ""
    for row in rows:
        if row["group"] != group:
            group = row["group"]
            table.add_section()
            table.add_row(Text(printable(group), style="bold"))
        values = []
        for side in ("left", "right"):
            sign = {True: " ✓", False: " ✗", None: ""}[row[side]["met"]]
            text = with_unit(row[side]["text"], row["unit"]) + sign
            values.append(Text(text, style="bold" if row["better"] == side else ""))
        table.add_row(Text(printable(row["title"])), *values, row["difference"] or "–")
    console.print(table)
