"""Show two runs in a terminal, without a study."""

from typing import Any

from rich.console import Console
from rich.panel import Panel as Box
from rich.table import Table
from rich.text import Text

from prefcal_env.experiments.panels import Plot
from prefcal_scenarios.app.presentation.wording import printable, with_unit
from prefcal_scenarios.app.web.view import Seen

from .drawing import curves
from .showing import STYLES, WIDE


def show_runs(
    sides: dict[str, tuple[str, Any]], panels: tuple[Plot, ...], rows: list[dict[str, Any]],
    console: Console,
) -> None:  # fmt: skip
    """Print the curves of both runs, next to each other if there is room, and their KPIs.

    Args:
        sides: Name and experiment of each side, "left" and "right".
        panels: Panels of both.
        rows: Their KPIs, as `comparison_view` returns them.
        console: Where to print.
    """
    wide = console.width >= WIDE
    width = (console.width // 2 if wide else console.width) - 6
    axes = Seen().frame(panels, *(experiment for _, experiment in sides.values()))
    boxes = [
        Box(curves(experiment, panels, axes, width=width, style=STYLES[side]),
            title=Text(printable(name)), title_align="left", border_style=STYLES[side])
        for side, (name, experiment) in sides.items()
    ]  # fmt: skip
    if wide:
        grid = Table.grid(expand=True)
        grid.add_column(ratio=1)
        grid.add_column(ratio=1)
        grid.add_row(*boxes)
        console.print(grid)
    else:
        for box in boxes:
            console.print(box)
    table = Table()
    for heading, style in (("KPI", ""), ("LEFT", STYLES["left"]), ("RIGHT", STYLES["right"])):
        table.add_column(heading, header_style=style, justify="right" if style else "left")
    table.add_column("right − left", justify="right")
    for row in rows:
        values = [
            Text(
                with_unit(row[side]["text"], row["unit"]),
                style="bold" if row["better"] == side else "",
            )
            for side in sides
        ]
        table.add_row(Text(printable(row["title"])), *values, row["difference"] or "–")
    console.print(table)
