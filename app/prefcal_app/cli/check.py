"""`prefcal check`: check a scenario with one trial run before a study."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import typer

from .options import Described
from .parameters import examples, given, made, option, takes

EPILOG = examples(
    ("check own.py:plant", "Your own scenario: the variable plant in the file own.py."),
    ('check own.py:plant --theta "K_p=2, K_i=0.1"', "The same at your current tuning, every knob given."),
    ("check cstr --out reactor.png", "A built-in scenario, with the picture in a file of your choice."),
    (
        'check loop.fmu --knob "K_p=0.1:50:log" --reference level=2',
        "An FMU with a controller in it; without knobs, its parameters are listed.",
    ),
    ("check pid --plant model.py:plant", "A PID on your own plant."),
    ("check tank.toml", "A scenario in a short file (`prefcal new` writes one)."),
    more="""\
[bold]What you see[/bold]

✓ passed, ✗ failed (with what was expected), · for your information.
An error in your own code is shown with its last line there. Look at the picture
too: only you know whether the curves are those of your plant.
""",
)


@dataclass(frozen=True, slots=True)
class CheckOptions(Described):
    """Options of `prefcal check`, in the order of its help.

    Args:
        theta: What to run: "KNOB=VALUE, ..." for every knob, or the name of a reference.
        out: File of the picture.
        json: Print the result as JSON, and nothing else, on stdout.
    """

    theta: str | None = option(None, "THETA", shown="the middle of the box")
    out: Path | None = option(None, "FILE.png", shown="./check-NAME.png")
    json: bool = option(False, flag="--json")


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
    from .choices import completed

    options = made(CheckOptions, typed)
    source = completed(given(CheckOptions, typed))["scenario"]
    with isolation(source, options.run_timeout) as isolated:
        code = run(source, isolated, theta=options.theta, out=options.out, as_json=options.json)
    raise typer.Exit(code)
