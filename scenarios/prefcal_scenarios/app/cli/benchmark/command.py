"""`prefcal bench`: compare agents on problems."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from prefcal_scenarios.app.cli.parameters import given, takes

EPILOG = """\
[bold]Examples[/bold]

[cyan]prefcal bench --quick[/cyan]
  Our own agents on seven problems: two and a half minutes of processor time.

[cyan]prefcal bench --out results[/cyan]
  Everything, 20 seeds. Stop with Ctrl-C; the same command resumes.

[cyan]prefcal bench --agents GLISp,GLIS --problems cstr,hartman6 --seeds 10[/cyan]
  Two agents, two problems.

[cyan]prefcal bench --quick --agents GLISp,own.py:MyAgent[/cyan]
  Your own agent: a class with ask, tell, done and best, made by
  MyAgent(space, n_init=10, n_max=50, seed=0).

[cyan]prefcal bench --agents GLISp --calibrators perfect --jobs 1[/cyan]
  One run at a time: only then are the times of proposals comparable.

[cyan]prefcal bench --dask tcp://10.0.0.5:8786[/cyan]
  On a Dask cluster whose workers have the same prefcal (and own.py).

[cyan]prefcal bench --quick --json > quick.json[/cyan]
  For programs: the digest, the table, the duels and what failed.

Results with the same digest are identical to the last bit, on any machine and
in any order. The exit code is 1 if a run failed, and 130 after Ctrl-C.
"""


@dataclass(frozen=True, slots=True)
class BenchOptions:
    """Options of `prefcal bench`, in the order of its help; None leaves it to the suite."""

    quick: Annotated[
        bool,
        typer.Option(
            "--quick", metavar="", help="Run a small suite; the options below change it, too."
        ),
    ] = False
    agents: Annotated[
        str | None,
        typer.Option(
            metavar="NAMES",
            help="Agents, separated by commas: names or own.py:Agent. All are compared with the "
            "first. A wrong name lists them all.",
            show_default="all that are installed",
        ),
    ] = None
    problems: Annotated[
        str | None,
        typer.Option(
            metavar="NAMES",
            help="Problems, separated by commas: test functions, cstr, cstr-guidelines and "
            "overtake. A wrong name lists them all.",
            show_default="all",
        ),
    ] = None
    calibrators: Annotated[
        str | None,
        typer.Option(
            metavar="NAMES",
            help="Who answers: perfect (by the cost), lexicographic (by criteria in their order), "
            "noisy10 or noisy20 (that percentage of the answers is wrong).",
            show_default="all",
        ),
    ] = None
    seeds: Annotated[
        int | None,
        typer.Option(
            min=1, metavar="N", help="Number of seeds: 0, 1, ..., N-1.", show_default="20; quick: 3"
        ),
    ] = None
    n_init: Annotated[
        int | None,
        typer.Option(
            min=1,
            metavar="N",
            help="Number of experiments before learning starts.",
            show_default="10, or half of --n-max if that is less",
        ),
    ] = None
    n_max: Annotated[
        int | None,
        typer.Option(min=2, metavar="N", help="Number of experiments.", show_default="50"),
    ] = None
    jobs: Annotated[
        int | None,
        typer.Option(
            min=1, metavar="N", help="Processes on this machine.", show_default="one per core"
        ),
    ] = None
    cell_timeout: Annotated[
        float | None,
        typer.Option(
            metavar="SECONDS",
            help="Most seconds that one cell may take on this machine; a longer one is ended and "
            "counts as failed. inf: no limit.",
            show_default="3600, an hour",
        ),
    ] = None
    dask: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS",
            help="Run on this Dask scheduler instead (pip install 'prefcal\\[dask]').",
        ),
    ] = None
    out: Annotated[
        Path,
        typer.Option(
            metavar="FOLDER", help="Folder of the results; results already in it are not run again."
        ),
    ] = Path("prefcal-bench")
    json: Annotated[
        bool,
        typer.Option(
            "--json",
            metavar="",
            help="Print only JSON on standard output (messages go to standard error).",
        ),
    ] = False
    csv: Annotated[
        bool,
        typer.Option("--csv", metavar="", help="Print only the table, as CSV, on standard output."),
    ] = False


@takes(BenchOptions)
def bench(**typed: Any) -> None:
    """Compare agents on problems, and write tables and figures.

    Every agent runs on every problem, with every calibrator and every seed.
    Each result is saved at once and never computed again: the same command
    resumes where it was stopped. A run that fails, crashes its process or takes
    too long is reported, and the others continue.
    """
    # Imported here to keep --help fast.
    from .run import run

    raise typer.Exit(run(BenchOptions(**given(BenchOptions, typed))))
