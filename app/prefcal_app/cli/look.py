"""`prefcal look`: compare runs from anywhere on one page, without a study."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from typer import Exit

from .parameters import argument, examples, made, option, takes

EPILOG = examples(
    (
        "look before.csv after.csv",
        "Both runs on one page: same axes, one cursor, KPIs with their differences.",
    ),
    (
        "look before.csv after.csv --reference level=2 --inputs valve",
        "With tracking errors of the level, and moves of the valve.",
    ),
    (
        'look a.csv b.csv --time Stamp --columns "level=TI-101.PV" --unit level=m',
        "Columns of a historian under names of your own.",
    ),
    (
        "look mine:3 mine:best plant.csv",
        "Experiments of the study mine, beside a record of the plant.",
    ),
    ("look a.csv b.csv --out pair.png", "The picture in a file, without a page."),
    ("look a.csv b.csv --json", "The KPIs of both, for programs."),
    more="""\
The first column, or one called time, is the time, in seconds or as time stamps.
Headings may have units, as in "level \\\\[m]". A column "level ref" is the reference
of level. All other columns of numbers are outputs.
""",
)


@dataclass(frozen=True, slots=True)
class LookOptions:
    """Options of `prefcal look`, in the order of its help."""

    runs: tuple[str, ...] = argument("RUN RUN ...", "CSV or Parquet files, or STUDY:3, STUDY:best.")
    time: str | None = option(None, "Column of time.", "NAME", shown="time, or the first one")
    time_format: str | None = option(None, "Format of time stamps.", "FORMAT", shown="ISO 8601")
    outputs: str = option("", "Columns to show.", "NAME,...", shown="all others")
    inputs: str = option("", "Columns that are inputs, drawn as steps.", "NAME,...")
    reference: tuple[str, ...] = option(
        (), "Reference of an output: a number, or a column.", "NAME=VALUE"
    )
    unit: tuple[str, ...] = option((), "Unit of a column without one.", "NAME=UNIT")
    columns: tuple[str, ...] = option((), "Name of your own for a column.", "NAME=HEADING")
    align: bool = option(False, "Let all runs start at time 0.", flag="--align")
    terminal: bool = option(False, "Show KPIs in this terminal.", flag="--terminal")
    browser: bool = option(True, "Only print the link.", flag="--no-browser")
    host: str = option("127.0.0.1", "Address of the page.", "ADDRESS")
    port: int = option(0, "Port of the page; 0: any free one.", "N")
    out: Path | None = option(None, "Write a picture instead.", "FILE.png")
    json: bool = option(False, "Print the KPIs as JSON instead.", flag="--json")


@takes(LookOptions)
def look(**typed: Any) -> None:
    """Show two or more runs beside each other, without a study.

    Runs may have different time bases, lengths and columns: columns of the same name and unit
    share a plot. Ctrl-C ends the page.
    """
    # Imported here to keep --help fast.
    from .look_run import run

    raise Exit(run(made(LookOptions, typed)))
