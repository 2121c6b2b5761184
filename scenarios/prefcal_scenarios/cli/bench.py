"""`prefcal bench`: what the agents are worth, measured."""

from pathlib import Path
from typing import Annotated

import typer

from prefcal_scenarios.cli.threads import one_thread

EPILOG = """\
[bold]Examples[/bold]

[cyan]prefcal bench --quick[/cyan]
  Our own agents on six problems: within two minutes on two cores.

[cyan]prefcal bench --out results[/cyan]
  Everything, 20 seeds. Stop it with Ctrl-C, and go on with the same line.

[cyan]prefcal bench --agents GLISp,GLIS --problems cstr,hartman6 --seeds 10[/cyan]
  Two agents, two problems.

[cyan]prefcal bench --quick --agents GLISp,own.py:MyAgent[/cyan]
  Your own agent: a class with ask, tell, done and best, made from a space, n_init, n_max and seed.

[cyan]prefcal bench --agents GLISp --calibrators perfect --jobs 1[/cyan]
  One cell at a time: only then is the time of a proposal measured.

[cyan]prefcal bench --dask tcp://10.0.0.5:8786[/cyan]
  On a Dask cluster whose workers have this prefcal, too (and own.py, at the same path).

[cyan]prefcal bench --quick --json > quick.json[/cyan]
  For programs: the digest, the table, the duels and what failed.

Results with the same digest are the same to the last bit, wherever and in whatever order they were
computed. The exit code is 1 if a cell failed, and 130 after Ctrl-C.
"""

_Quick = Annotated[
    bool, typer.Option("--quick", help="A small suite; the options below change it, too.")
]
_Agents = Annotated[
    str | None,
    typer.Option(
        metavar="NAMES",
        help="Names with commas between, or own.py:Agent. A wrong name lists them all.",
        show_default="all that are installed",
    ),
]
_Problems = Annotated[
    str | None,
    typer.Option(
        metavar="NAMES",
        help="Test functions, cstr and overtake, with commas between.",
        show_default="all",
    ),
]
_Calibrators = Annotated[
    str | None,
    typer.Option(
        metavar="NAMES",
        help="Who answers: perfect (by the cost), lexicographic (by criteria in their order), "
        "noisy10, noisy20 (that share of the answers is wrong).",
        show_default="all",
    ),
]
_Seeds = Annotated[
    int | None, typer.Option(help="How many seeds: 0, 1, ...", show_default="20; quick: 3")
]
_Initial = Annotated[
    int | None,
    typer.Option(
        help="Experiments before learning starts.",
        show_default="10, or half of --n-max if that is less",
    ),
]
_Experiments = Annotated[int | None, typer.Option(help="Experiments in all.", show_default="50")]
_Jobs = Annotated[
    int | None, typer.Option(help="Processes on this machine.", show_default="one a core")
]
_Dask = Annotated[
    str | None,
    typer.Option(
        metavar="ADDRESS", help="A Dask scheduler to run on instead: pip install 'prefcal[dask]'."
    ),
]
_Folder = Annotated[
    Path,
    typer.Option(help="Folder of the results; what it holds already is not computed again."),
]
_Json = Annotated[
    bool, typer.Option("--json", help="Print the result as JSON, and nothing else, on stdout.")
]
_Csv = Annotated[
    bool, typer.Option("--csv", help="Print the table as CSV, and nothing else, on stdout.")
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
    dask: _Dask = None,
    out: _Folder = Path("prefcal-bench"),
    json: _Json = False,
    csv: _Csv = False,
) -> None:
    """Measure agents on problems, and write tables and figures of it.

    Every agent runs on every problem, before every calibrator and with every seed: one cell each.
    Each result is saved as it lands, and never computed again: the same line goes on where it was
    stopped. A cell that fails, or kills its process, is reported, and the others go on.
    """
    one_thread()
    # Here, not above: --help must not wait for it, and numpy reads the environment once.
    from prefcal_scenarios.cli.benching import Wishes, run

    wishes = Wishes(quick, agents, problems, calibrators, seeds, n_init, n_max, jobs, dask)
    raise typer.Exit(run(wishes, out, json=json, csv=csv))
