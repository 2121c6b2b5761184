"""`prefcal bench`: compare agents on problems."""

from pathlib import Path
from typing import Annotated

import typer

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

_Quick = Annotated[
    bool,
    typer.Option(
        "--quick", metavar="", help="Run a small suite, which the options below can change."
    ),
]
_Agents = Annotated[
    str | None,
    typer.Option(
        metavar="NAMES",
        help="Agents, separated by commas: names or own.py:Agent. All are compared with the first. "
        "An unknown name lists all of them.",
        show_default="all that are installed",
    ),
]
_Problems = Annotated[
    str | None,
    typer.Option(
        metavar="NAMES",
        help="Problems, separated by commas: test functions, cstr, cstr-guidelines and overtake. "
        "An unknown name lists all of them.",
        show_default="all",
    ),
]
_Calibrators = Annotated[
    str | None,
    typer.Option(
        metavar="NAMES",
        help="Who answers: perfect (by the cost), lexicographic (by ordered criteria), noisy10 or "
        "noisy20 (that percentage of the answers is wrong).",
        show_default="all",
    ),
]
_Seeds = Annotated[
    int | None,
    typer.Option(
        min=1, metavar="N", help="Number of seeds: 0, 1, ..., N-1.", show_default="20; quick: 3"
    ),
]
_Initial = Annotated[
    int | None,
    typer.Option(
        min=1,
        metavar="N",
        help="Number of experiments before learning starts.",
        show_default="10, or half of --n-max if that is less",
    ),
]
_Experiments = Annotated[
    int | None, typer.Option(min=2, metavar="N", help="Number of experiments.", show_default="50")
]
_Jobs = Annotated[
    int | None,
    typer.Option(
        min=1, metavar="N", help="Processes on this machine.", show_default="one per core"
    ),
]
_Timeout = Annotated[
    float | None,
    typer.Option(
        metavar="SECONDS",
        help="Time limit for one cell on this machine; a longer one is ended and counts as "
        "failed. inf: no limit.",
        show_default="3600, an hour",
    ),
]
_Dask = Annotated[
    str | None,
    typer.Option(
        metavar="ADDRESS",
        help="Run on this Dask scheduler instead (pip install 'prefcal\\[dask]').",
    ),
]
_Folder = Annotated[
    Path,
    typer.Option(
        metavar="FOLDER", help="Folder of the results; results already in it are not run again."
    ),
]
_Json = Annotated[
    bool,
    typer.Option(
        "--json",
        metavar="",
        help="Print only JSON on standard output (messages go to standard error).",
    ),
]
_Csv = Annotated[
    bool,
    typer.Option("--csv", metavar="", help="Print only the table, as CSV, on standard output."),
]


def bench(
    quick: _Quick = False,
    agents: _Agents = None,
    problems: _Problems = None,
    calibrators: _Calibrators = None,
    seeds: _Seeds = None,
    n_init: _Initial = None,
    n_max: _Experiments = None,
    jobs: _Jobs = None,
    cell_timeout: _Timeout = None,
    dask: _Dask = None,
    out: _Folder = Path("prefcal-bench"),
    json: _Json = False,
    csv: _Csv = False,
) -> None:
    """Compare agents on problems, and write tables and figures.

    Every agent runs on every problem, with every calibrator and every seed.
    Each result is saved at once and never computed again: the same command
    resumes where it was stopped. A run that fails, crashes its process or takes
    too long is reported, and the others continue.
    """
    # Imported here to keep --help fast.
    from .run import BenchOptions, run

    options = BenchOptions(
        quick, agents, problems, calibrators, seeds, n_init, n_max, jobs, dask, cell_timeout
    )
    raise typer.Exit(run(options, out, json=json, csv=csv))
