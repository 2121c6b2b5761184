"""Options of `prefcal look`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from typer import Argument, Option


@dataclass(frozen=True, slots=True)
class LookOptions:
    """Options of `prefcal look`, in the order of its help."""

    runs: Annotated[
        tuple[str, ...],
        Argument(metavar="RUN RUN ...", help="CSV or Parquet files, or STUDY:3, STUDY:best."),
    ]
    time: Annotated[
        str | None,
        Option(metavar="NAME", help="Column of time.", show_default="time, or the first one"),
    ] = None
    time_format: Annotated[
        str | None,
        Option(metavar="FORMAT", help="Format of time stamps.", show_default="ISO 8601"),
    ] = None
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
    terminal: Annotated[bool, Option("--terminal", help="Show KPIs in this terminal.")] = False
    browser: Annotated[bool, Option("--no-browser", help="Only print the link.")] = True
    host: Annotated[str, Option(metavar="ADDRESS", help="Address of the page.")] = "127.0.0.1"
    port: Annotated[int, Option(metavar="N", help="Port of the page; 0: any free one.")] = 0
    out: Annotated[Path | None, Option(metavar="FILE.png", help="Write a picture instead.")] = None
    json: Annotated[bool, Option("--json", help="Print the KPIs as JSON instead.")] = False
