"""`prefcal bench`: compare agents on problems, or one agent with published runs."""

from typing import Any

import typer

from prefcal_app.cli.parameters import takes

from .options import BenchOptions, CompareOptions

app = typer.Typer(name="bench", add_completion=False, rich_markup_mode="rich")

EPILOG = """\
[bold]Examples[/bold]

[cyan]prefcal bench --quick[/cyan]
  Our own agents on three closed loops and more: two minutes of computing.

[cyan]prefcal bench --out results[/cyan]
  Everything, 20 seeds. Stop with Ctrl-C; the same command resumes.

[cyan]prefcal bench --agents GLISp,GLIS --problems servo,hartman6 --seeds 10[/cyan]
  Two agents, two problems: a closed loop with every taste, a test function.

[cyan]prefcal bench --problems own.py:scenario --calibrators priorities[/cyan]
  Your own Scenario, judged by people with priorities.

[cyan]prefcal bench --quick --agents GLISp,own.py:MyAgent[/cyan]
  Your own agent: a class with ask, tell, done and best, made by
  MyAgent(space, n_init=10, n_max=50, seed=0).

[cyan]prefcal bench compare own.py:MyAgent[/cyan]
  Your own agent on the closed loops, beside published runs of the others.

[cyan]prefcal bench --agents GLISp --calibrators perfect --jobs 1[/cyan]
  One run at a time: only then are the times of proposals comparable.

[cyan]prefcal bench --quick --json > quick.json[/cyan]
  For programs: the digest, the table, the duels and what failed.

Results with the same digest are identical to the last bit, on any machine and
in any order. The exit code is 1 if a run failed, and 130 after Ctrl-C.
"""


COMPARE_EPILOG = """\
[bold]Examples[/bold]

[cyan]prefcal bench compare own.py:MyAgent --problems servo --seeds 5[/cyan]
  A first look: one closed loop, all tastes, five seeds.

[cyan]prefcal bench compare own.py:MyAgent --calibrators weights --out mine[/cyan]
  All loops, with one taste. Stop with Ctrl-C; the same command resumes.

[cyan]prefcal bench compare GLISp --published ours.parquet[/cyan]
  The installed GLISp, for example after a change, against runs of your own.

[bold]The agent[/bold]

A class with ask, tell, done and best, made by
MyAgent(space, n_init=10, n_max=50, seed=0).

The page shows what the worth of its θ is after each experiment and each
answer, and how likely each published agent is to do better.
"""


@app.callback(invoke_without_command=True, epilog=EPILOG)
@takes(BenchOptions)
def bench(typed: dict[str, Any], context: typer.Context) -> None:
    """Compare agents on problems, and write tables and figures.

    Every agent runs on every problem, with every calibrator and every seed.
    Each result is saved at once and never computed again: the same command
    resumes where it was stopped. A run that fails, crashes its process or takes
    too long is reported, and the others continue.
    """
    if context.invoked_subcommand is not None:
        if typed:
            raise typer.BadParameter(f"options come after {context.invoked_subcommand}")
        return
    # Imported here to keep --help fast.
    from .run import run

    raise typer.Exit(run(BenchOptions(**typed)))


@app.command(epilog=COMPARE_EPILOG)
@takes(CompareOptions)
def compare(typed: dict[str, Any]) -> None:
    """Compare AGENT with published runs of other agents, which do not run again.

    Only AGENT runs: on the published closed loops, with their tastes and seeds.
    The page, figures and tables are those of `prefcal bench`; all agents are
    compared with yours.
    """
    # Imported here to keep --help fast.
    from .run import compare as run

    raise typer.Exit(run(CompareOptions(**typed)))
