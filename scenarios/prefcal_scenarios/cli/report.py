"""`prefcal report`: the report of a study, at any time."""

from pathlib import Path
from typing import Annotated

import typer

EPILOG = """\
[bold]Examples[/bold]

[cyan]prefcal report mine[/cyan]
  Write the report of the study called mine into the folder prefcal-mine.

[cyan]prefcal report plant-1 --scenario own.py:plant --out latest[/cyan]
  Of a study of your own scenario, into a folder of your choice.
"""


def report(
    study: Annotated[str, typer.Argument(metavar="STUDY", help="A name, or the path of a file.")],
    scenario: Annotated[
        str | None,
        typer.Option(
            metavar="FILE.py:NAME",
            help="Where your own scenario is. A study file alone never makes prefcal run a "
            "program.",
            show_default="the built-in one that the study names",
        ),
    ] = None,
    cost: Annotated[
        str | None,
        typer.Option(
            metavar="FILE.py:NAME",
            help="The cost that the study was started with, if it was: it is a program, too.",
            show_default="the scenario's score",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            help="Folder of the report; may exist, but not with the report of another study.",
            show_default="./prefcal-STUDY",
        ),
    ] = None,
    json: Annotated[
        bool,
        typer.Option(
            "--json",
            metavar="",
            help="Print only JSON on standard output (messages go to standard error).",
        ),
    ] = False,
) -> None:
    """Write the report of a study as it stands, complete or not."""
    from prefcal_scenarios.cli.reporting import report_of

    report_of(study, {"scenario": scenario, "cost": cost}, out, json=json)
