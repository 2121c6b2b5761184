"""`prefcal processor`: files for judging computation times on a computer of your choice."""

from pathlib import Path
from typing import Annotated

import typer

from prefcal_scenarios.cli.threads import one_thread

app = typer.Typer(
    name="processor",
    help="Describe the computer that a controller has to run on, for `calibrate --processor`.",
    no_args_is_help=True,
    rich_markup_mode="rich",
)

MEASURE_EPILOG = """\
[bold]Examples[/bold]

[cyan]prefcal processor measure[/cyan]
  Time the overtaking's controller on this machine; writes processor.json.

[cyan]prefcal calibrate overtake --processor processor.json[/cyan]
  A calibration in which the controller must run in real time on it.
"""
CYCLES_EPILOG = """\
[bold]Examples[/bold]

[cyan]prefcal processor from-cycles cycles.csv --clock-mhz 300 --out target.json[/cyan]
  A target with a clock of 300 MHz, from cycle counts of steps that you timed on it.

[bold]The file[/bold]

One row for each timed step, from three or more pairs of N_p and N_u:
phase,N_p,N_u,iterations,cycles
lane keeping,10,3,6,412000
overtaking,16,5,9,1270000
In place of N_u, ε_c (or eps_c) may be given.
"""

_Name = Annotated[
    str | None,
    typer.Option(metavar="TEXT", help="Name of the processor.", show_default="the file's"),
]
_Out = Annotated[Path, typer.Option(metavar="FILE.json", help="The file to write.")]


@app.command(epilog=MEASURE_EPILOG)
def measure(
    rounds: Annotated[
        int,
        typer.Option(min=1, metavar="N", help="How often each step is timed; the shortest counts."),
    ] = 15,
    name: _Name = None,
    out: _Out = Path("processor.json"),
) -> None:
    """Time the overtaking's controller on this machine, and write its processor file.

    Close what else is running: only then do the times belong to the controller.
    """
    one_thread()
    # Here, not above: --help must not wait for it, and numpy reads the environment once.
    from prefcal_scenarios.cli.processing import measure_here

    measure_here(rounds, name or out.stem, out)


@app.command("from-cycles", epilog=CYCLES_EPILOG)
def from_cycles(
    file: Annotated[
        Path, typer.Argument(metavar="FILE.csv", help="Cycle counts of timed steps, see below.")
    ],
    clock_mhz: Annotated[float, typer.Option(metavar="MHZ", help="Clock rate of the target.")],
    name: _Name = None,
    out: _Out = Path("processor.json"),
) -> None:
    """Make the processor file of an embedded target from cycle counts."""
    one_thread()
    from prefcal_scenarios.cli.processing import convert

    convert(file, clock_mhz, name or out.stem, out)
