"""`prefcal look`: compare runs from anywhere on one page, without a study."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from typer import Argument, Exit, Option

from prefcal_scenarios.app.cli.parameters import given, takes

EPILOG = """\
[bold]Examples[/bold]

[cyan]prefcal look before.csv after.csv[/cyan]
  Both runs on one page: same axes, one cursor, KPIs with their differences.

[cyan]prefcal look before.csv after.csv --reference level=2 --inputs valve[/cyan]
  With tracking errors of the level, and moves of the valve.

[cyan]prefcal look a.csv b.csv --time Stamp --columns "level=TI-101.PV" --unit level=m[/cyan]
  Columns of a historian under names of your own.

[cyan]prefcal look mine:3 mine:best plant.csv[/cyan]
  Experiments of the study mine, beside a record of the plant.

[cyan]prefcal look a.csv b.csv --out pair.png[/cyan]
  The picture in a file, without a page.

[cyan]prefcal look a.csv b.csv --json[/cyan]
  The KPIs of both, for programs.

The first column, or one called time, is the time, in seconds or as time stamps.
Headings may have units, as in "level [m]". A column "level ref" is the reference
of level. All other columns of numbers are outputs.
"""


@dataclass(frozen=True, slots=True)
class LookOptions:
    """Options of `prefcal look`, in the order of its help."""

    runs: Annotated[
        tuple[str, ...],
        Argument(metavar="RUN RUN ...", help="CSV or Parquet files, or STUDY:3, STUDY:best."),
    ]
    time: Annotated[
        str, Option(metavar="NAME", help="Column of time.", show_default="time, or the first one")
    ] = ""
    outputs: Annotated[
        str, Option(metavar="NAME,...", help="Columns to show.", show_default="all others")
    ] = ""
    inputs: Annotated[
        str, Option(metavar="NAME,...", help="Columns that are inputs, drawn as steps.")
    ] = ""
    reference: Annotated[
        tuple[str, ...],
        Option(metavar="NAME=VALUE", help="Reference of an output: a number, or a column."),
    ] = ()
    unit: Annotated[
        tuple[str, ...], Option(metavar="NAME=UNIT", help="Unit of a column without one.")
    ] = ()
    columns: Annotated[
        tuple[str, ...], Option(metavar="NAME=HEADING", help="Name of your own for a column.")
    ] = ()
    align: Annotated[bool, Option("--align", help="Let all runs start at time 0.")] = False
    terminal: Annotated[bool, Option("--terminal", help="Show them in this terminal.")] = False
    browser: Annotated[bool, Option("--no-browser", help="Only print the link.")] = True
    host: Annotated[str, Option(metavar="ADDRESS", help="Address of the page.")] = "127.0.0.1"
    port: Annotated[int, Option(metavar="N", help="Port of the page; 0: any free one.")] = 0
    out: Annotated[Path | None, Option(metavar="FILE.png", help="Write a picture instead.")] = None
    json: Annotated[bool, Option("--json", help="Print the KPIs as JSON instead.")] = False


@takes(LookOptions)
def look(**typed: Any) -> None:
    """Show two or more runs beside each other, without a study.

    Runs may have different time bases, lengths and columns: columns of the same name and unit
    share a plot. Ctrl-C ends the page.
    """
    # Imported here to keep --help fast.
    from .run import run

    values = {name: value for name, value in given(LookOptions, typed).items() if value is not None}
    raise Exit(run(LookOptions(**values)))
