"""`prefcal look`: compare runs from anywhere on one page, without a study."""

from typing import Any

from typer import Exit

from prefcal_app.cli.parameters import given, takes

from .options import LookOptions

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
Headings may have units, as in "level \\[m]". A column "level ref" is the reference
of level. All other columns of numbers are outputs.
"""


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
