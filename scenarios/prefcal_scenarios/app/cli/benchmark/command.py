"""`prefcal bench`: compare agents on problems."""

from typing import Any

import typer

from prefcal_scenarios.app.cli.parameters import given, takes

from .options import BenchOptions

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
