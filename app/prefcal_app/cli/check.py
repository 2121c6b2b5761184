"""`prefcal check`: check a scenario with one trial run before a study."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from .describing.options import (
    KnobOption,
    PlantOption,
    ReferenceOption,
    ShowOption,
    StopTimeOption,
)
from .parameters import given, takes

EPILOG = """\
[bold]Examples[/bold]

[cyan]prefcal check own.py:plant[/cyan]
  Your own scenario: the variable plant in the file own.py.

[cyan]prefcal check own.py:plant --theta "K_p=2, K_i=0.1"[/cyan]
  The same at your current tuning, every knob given.

[cyan]prefcal check cstr --out reactor.png[/cyan]
  A built-in scenario, with the picture in a file of your choice.

[cyan]prefcal check loop.fmu --knob "K_p=0.1:50:log" --reference level=2[/cyan]
  An FMU with a controller in it; without knobs, its parameters are listed.

[cyan]prefcal check pid --plant model.py:plant[/cyan]
  A PID on your own plant.

[cyan]prefcal check tank.toml[/cyan]
  A scenario in a short file (`prefcal new` writes one).

[bold]What you see[/bold]

✓ passed, ✗ failed (with what was expected), · for your information.
An error in your own code is shown with its last line there. Look at the picture
too: only you know whether the curves are those of your plant.
"""


@dataclass(frozen=True, slots=True)
class CheckOptions:
    """Options of `prefcal check`, in the order of its help."""

    scenario: Annotated[
        str,
        typer.Argument(
            metavar="SCENARIO",
            help="own.py:name, tank.toml, loop.fmu, pid or lqr with --plant, or a name (see "
            "`prefcal scenarios`).",
        ),
    ]
    theta: Annotated[
        str | None,
        typer.Option(
            metavar="THETA",
            help='What to run: "KNOB=VALUE, ..." for every knob, or the name of a reference.',
            show_default="the middle of the box",
        ),
    ] = None
    knob: KnobOption = ()
    show: ShowOption = ()
    reference: ReferenceOption = ()
    plant: PlantOption = None
    stop_time: StopTimeOption = None
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.png", help="File of the picture.", show_default="./check-NAME.png"
        ),
    ] = None
    run_timeout: Annotated[
        float,
        typer.Option(
            metavar="SECONDS",
            help="Time limit for one run of your own scenario. inf: no limit.",
            show_default="3600, an hour",
        ),
    ] = 3600.0
    json: Annotated[
        bool, typer.Option("--json", help="Print the result as JSON, and nothing else, on stdout.")
    ] = False


@takes(CheckOptions)
def check(**typed: Any) -> None:
    """Run SCENARIO once, check all that a study relies on, and draw its panels.

    The checks cover θ and how its run ended, the record, channels and panels, KPIs
    and their goals, the cost, the calibrators, the references, the controller,
    whether the same θ and seed give the same experiment, and whether a study can
    store it. Ends with exit code 1 if anything is wrong.
    """
    # Imported here to keep --help fast.
    from prefcal_scenarios.isolated import isolation

    from .checkup import run
    from .describing.source import source_of

    options = given(CheckOptions, typed)
    said = {name: value for name, value in options.items() if value is not None}
    wanted = CheckOptions(**{**said, "scenario": source_of(options)})
    with isolation(wanted.scenario, wanted.run_timeout) as isolated:
        code = run(
            wanted.scenario, isolated, theta=wanted.theta, out=wanted.out, as_json=wanted.json
        )
    raise typer.Exit(code)
