"""`prefcal reproduce`: repeat the paper's case studies."""

import json as json_
import shlex
from collections.abc import Sequence
from contextlib import closing
from dataclasses import asdict
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from prefcal_bench.cli.display import BenchDisplay
    from prefcal_bench.reproduce import PaperStudy

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


class What(StrEnum):
    """Results that can be reproduced."""

    PAPER = "paper"


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
    raise typer.Exit(_run(seeds, jobs, out, json=json))


def _run(seeds: int, jobs: int | None, out: Path, *, json: bool) -> int:
    """Run all studies, write the page, and print its path; return the exit code.

    Raises:
        SettingsError: If `out` is a file, or cannot be made or written to.
        BenchmarkError: If a study ended without a result.
    """
    # Imported here to keep --help fast.
    from rich.console import Console

    from prefcal_app.cli.interrupt import INTERRUPTED, interruption
    from prefcal_bench.cli.display import BenchDisplay
    from prefcal_bench.reproduce import write_page
    from prefcal_env.workers import usable_cores
    from prefcal_scenarios.presentation.folder import folder_for

    folder, messages = folder_for(out), Console(stderr=True, emoji=False)
    with interruption() as pressed, BenchDisplay(messages) as display:
        try:
            with pressed.allowed():
                studies = _studies(seeds, jobs or usable_cores(), display)
        except KeyboardInterrupt:
            display.say("Stopped; nothing was written.")
            return INTERRUPTED
    words = ["prefcal", "reproduce", "paper", "--seeds", str(seeds), "--out", str(out)]
    messages.print("Drawing the page …", highlight=False)
    page = write_page(studies, folder, shlex.join(words))
    if json:
        print(json_.dumps({"page": str(page), "studies": [asdict(s) for s in studies]}, indent=2))
    else:
        Console(soft_wrap=True).print(f"Page: {page}", highlight=False, markup=False)
    return 0


def _studies(seeds: int, jobs: int, display: "BenchDisplay") -> "Sequence[PaperStudy]":
    """Run all studies; return them sorted by seed and case."""
    from prefcal_bench.cells.engine import Processes, each
    from prefcal_bench.reproduce import tasks
    from prefcal_env.errors import BenchmarkError, RunError

    waiting = dict(enumerate(tasks(range(seeds))))
    display.begin("studies", len(waiting), 0)
    results: dict[int, PaperStudy] = {}
    with closing(each(waiting, Processes(min(jobs, len(waiting))))) as landing:
        for number, result in landing:
            if isinstance(result, RunError):
                raise BenchmarkError(f"a study ended without a result: {result}")
            results[number] = result
            display.landed(f"{result.case}, seed {result.seed}")
    return [results[number] for number in waiting]
