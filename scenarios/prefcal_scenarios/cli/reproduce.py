"""`prefcal reproduce`: the paper's case studies, done again."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from prefcal_scenarios.cli.threads import one_thread

EPILOG = """\
[bold]Examples[/bold]

[cyan]prefcal reproduce paper[/cyan]
  Both case studies, five times each: half a minute on two idle cores.

[cyan]prefcal reproduce paper --seeds 20 --out paper-20[/cyan]
  Twenty times each, into a folder of your choice.

[bold]What you get[/bold]

paper.html, one page to read or to send: each figure and each printed value of
section IV beside ours, what agrees and what does not, and every deviation with
its reason. The figures are beside it as PNG files.
"""


class What(StrEnum):
    """What can be reproduced."""

    PAPER = "paper"


def reproduce(
    what: Annotated[What, typer.Argument(metavar="WHAT", help="paper: section IV of the paper.")],
    seeds: Annotated[
        int, typer.Option(min=1, help="How many times each study is done, from seed 0 on.")
    ] = 5,
    jobs: Annotated[
        int | None,
        typer.Option(min=1, help="Processes side by side.", show_default="all cores"),
    ] = None,
    out: Annotated[
        Path, typer.Option(metavar="FOLDER", help="Folder of the page; may exist.")
    ] = Path("prefcal-paper"),
    json: Annotated[
        bool, typer.Option("--json", help="Print the result as JSON, and nothing else, on stdout.")
    ] = False,
) -> None:
    """Do the paper's case studies again, and put its results beside ours in one page.

    GLISp with the paper's settings calibrates the reactor and the car by preferences,
    GLIS calibrates the reactor by its performance index. Nobody is asked: synthetic
    calibrators take the place of the person.
    """
    one_thread()
    # Here, not above: --help must not wait for it, and numpy reads the environment once.
    from prefcal_scenarios.cli.reproducing import run

    raise typer.Exit(run(seeds, jobs, out, json=json))
