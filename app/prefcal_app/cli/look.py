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
    ("look mine:3 mine:best plant.csv", "Experiments of the study mine, beside a record of the plant."),
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
    """Options of `prefcal look`, in the order of its help.

    Args:
        runs: CSV or Parquet files, or STUDY:3, STUDY:best.
        time: Column of time.
        time_format: Format of time stamps.
        outputs: Columns to show.
        inputs: Columns that are inputs, drawn as steps.
        reference: Reference of an output: a number, or a column.
        unit: Unit of a column without one.
        columns: Name of your own for a column.
        align: Let all runs start at time 0.
        terminal: Show KPIs in this terminal.
        browser: Only print the link.
        host: Address of the page.
        port: Port of the page; 0: any free one.
        out: Write a picture instead.
        json: Print the KPIs as JSON instead.
    """

    runs: tuple[str, ...] = argument("RUN RUN ...")
    time: str | None = option(None, "NAME", shown="time, or the first one")
    time_format: str | None = option(None, "FORMAT", shown="ISO 8601")
    outputs: str = option("", "NAME,...", shown="all others")
    inputs: str = option("", "NAME,...")
    reference: tuple[str, ...] = option((), "NAME=VALUE")
    unit: tuple[str, ...] = option((), "NAME=UNIT")
    columns: tuple[str, ...] = option((), "NAME=HEADING")
    align: bool = option(False, flag="--align")
    terminal: bool = option(False, flag="--terminal")
    browser: bool = option(True, flag="--no-browser")
    host: str = option("127.0.0.1", "ADDRESS")
    port: int = option(0, "N")
    out: Path | None = option(None, "FILE.png")
    json: bool = option(False, flag="--json")


@takes(LookOptions)
def look(**typed: Any) -> None:
    """Show two or more runs beside each other, without a study.

    Runs may have different time bases, lengths and columns: columns of the same name and unit
    share a plot. Ctrl-C ends the page.
    """
    # Imported here to keep --help fast.
    from .look_run import run

    raise Exit(run(made(LookOptions, typed)))
