"""`prefcal reproduce`: repeat the paper's case studies."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

EPILOG = """\
[bold]Examples[/bold]

[cyan]prefcal reproduce paper[/cyan]
  Both case studies, five times each: half a minute on two idle cores.

[cyan]prefcal reproduce paper --seeds 20 --out paper-20[/cyan]
  Twenty times each, into a folder of your choice.

[bold]What you get[/bold]

paper.html, one page to read or to send: each figure and each printed value of
section IV beside ours, what was compared with what, where the results disagree,
and every deviation with its reason. The figures are beside it as PNG files.
"""


app = typer.Typer(name="reproduce", add_completion=False, rich_markup_mode="rich")


class What(StrEnum):
    """Results that can be reproduced."""

    PAPER = "paper"


@app.command(no_args_is_help=True, epilog=EPILOG)
def reproduce(
    what: Annotated[What, typer.Argument(metavar="WHAT", help="paper: section IV of the paper.")],
    seeds: Annotated[int, typer.Option(min=1, help="Number of runs of each study, with seeds 0, 1, ...")] = 5,
    jobs: Annotated[
        int | None, typer.Option(min=1, help="Number of parallel processes.", show_default="all cores")
    ] = None,
    out: Annotated[Path, typer.Option(metavar="FOLDER", help="Folder of the page; may exist.")] = Path(
        "prefcal-paper"
    ),
    json: Annotated[
        bool, typer.Option("--json", help="Print the result as JSON, and nothing else, on stdout.")
    ] = False,
) -> None:
    """Repeat the paper's case studies, and show its results and ours on one page.

    GLISp with the paper's settings calibrates the reactor and the car by preferences,
    and GLIS calibrates the reactor by its performance index. Synthetic calibrators
    answer in place of a person.
    """
    from .reproduce_run import run  # here, to keep --help fast

    raise typer.Exit(run(seeds, jobs, out, json=json))
