"""`prefcal report`: the report of a study, at any time."""

from pathlib import Path
from typing import Annotated

import typer


def report(
    study: Annotated[str, typer.Argument(metavar="STUDY", help="A name, or the path of a file.")],
    scenario: Annotated[
        str | None,
        typer.Option(
            help="Your own scenario, own.py:name: a study file never makes us run a program.",
            show_default="the built-in one that the study names",
        ),
    ] = None,
    cost: Annotated[
        str | None,
        typer.Option(
            metavar="FILE.py:NAME",
            help="The cost that the study was begun with, if it was: a program, too.",
            show_default="the scenario's score",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder; may exist.", show_default="./prefcal-SCENARIO-SEED"),
    ] = None,
    json: Annotated[
        bool, typer.Option("--json", help="Print the result as JSON, and nothing else, on stdout.")
    ] = False,
) -> None:
    """Write the report of a study as it stands, complete or not."""
    from prefcal_scenarios.cli.reporting import report_of

    report_of(study, {"scenario": scenario, "cost": cost}, out, json=json)
