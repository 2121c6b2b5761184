"""`prefcal check`: one trial run of a scenario, before anybody is asked."""

from pathlib import Path
from typing import Annotated

import typer

from prefcal_scenarios.cli.threads import one_thread

EPILOG = """\
[bold]Examples[/bold]

[cyan]prefcal check own.py:plant[/cyan]
  Your own scenario: the variable plant in the file own.py.

[cyan]prefcal check own.py:plant --theta "K_p=2, K_i=0.1"[/cyan]
  The same at your present tuning, every knob given.

[cyan]prefcal check cstr --out reactor.png[/cyan]
  A built-in scenario, with the picture in a file of your choice.

[bold]What you see[/bold]

✓ is in order, ✗ is wrong and says what was expected, · is for your information.
An error in your own code is shown with its last line there. Look at the picture
too: only you know whether the curves are those of your plant.
"""


def check(
    scenario: Annotated[
        str,
        typer.Argument(
            metavar="SCENARIO", help="own.py:name, or a name (see `prefcal scenarios`)."
        ),
    ],
    theta: Annotated[
        str | None,
        typer.Option(
            metavar="THETA",
            help='What to run: "KNOB=VALUE, ..." for every knob, or the name of a reference.',
            show_default="the middle of the box",
        ),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the run.")] = 0,
    out: Annotated[
        Path | None,
        typer.Option(metavar="FILE.png", help="The picture.", show_default="./check-NAME.png"),
    ] = None,
    run_timeout: Annotated[
        float,
        typer.Option(
            metavar="SECONDS",
            help="Most seconds that one run of your own scenario may take. inf: no limit.",
            show_default="3600, an hour",
        ),
    ] = 3600.0,
    open_: Annotated[bool, typer.Option("--open", help="Open the picture.")] = False,
    json: Annotated[
        bool, typer.Option("--json", help="Print the result as JSON, and nothing else, on stdout.")
    ] = False,
) -> None:
    """Run SCENARIO once, check all that a study relies on, and draw its panels.

    Checked are: θ and what came of it, the record, channels and panels, KPIs and
    their goals, the cost, the calibrators, the references, the controller, whether
    the same θ and seed give the same experiment, and whether a study can store it.
    Ends with exit code 1 if anything is wrong.
    """
    one_thread()
    # Here, not above: --help must not wait for it, and numpy reads the environment once.
    from prefcal_scenarios.cli.checking import Wanted, run_check

    raise typer.Exit(run_check(scenario, Wanted(theta, seed, out, open_, json, run_timeout)))
