"""`prefcal processor`: write files for evaluating computation times on another computer."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from prefcal_env.mpc.processors import TimedStep

app = typer.Typer(
    name="processor",
    help="Describe the computer that a controller has to run on, for `calibrate --processor`.",
    no_args_is_help=True,
    rich_markup_mode="rich",
)

MEASURE_EPILOG = """\
[bold]Examples[/bold]

[cyan]prefcal processor measure[/cyan]
  Time the overtaking controller on this machine; writes processor.json.

[cyan]prefcal calibrate overtake --processor processor.json[/cyan]
  A calibration in which the controller must run in real time on that machine.
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
N_u can be replaced by ε_c (or eps_c).
"""

_PAPER = "paper, preferences"
"""The reference θ of the overtaking scenario that is timed."""

_Name = Annotated[
    str | None,
    typer.Option(metavar="TEXT", help="Name of the processor.", show_default="the file's"),
]
_Out = Annotated[Path, typer.Option(metavar="FILE.json", help="The file to write.")]


@app.command(epilog=MEASURE_EPILOG)
def measure(
    rounds: Annotated[
        int,
        typer.Option(
            min=1, metavar="N", help="Number of times each step is timed; the shortest counts."
        ),
    ] = 15,
    name: _Name = None,
    out: _Out = Path("processor.json"),
) -> None:
    """Time the overtaking controller on this machine, and write its processor file.

    Close other programs first, so that only the controller is timed.
    """
    # Imported here to keep --help fast.
    from rich.console import Console
    from rich.progress import track

    from prefcal_scenarios.cases.overtake import overtake
    from prefcal_scenarios.cases.overtake.measuring import timed_steps

    messages = Console(stderr=True)
    overtake.run(overtake.references[_PAPER])  # compile first, to exclude it from the times
    steps = timed_steps(
        rounds, lambda thetas: track(list(thetas), "timing the controller", console=messages)
    )
    _conclude(steps, name or out.stem, out)


@app.command("from-cycles", epilog=CYCLES_EPILOG)
def from_cycles(
    file: Annotated[
        Path, typer.Argument(metavar="FILE.csv", help="Cycle counts of timed steps, see below.")
    ],
    clock_mhz: Annotated[float, typer.Option(metavar="MHZ", help="Clock rate of the target.")],
    name: _Name = None,
    out: _Out = Path("processor.json"),
) -> None:
    """Write the processor file of an embedded target from its cycle counts."""
    from prefcal_scenarios.cases.overtake.cycles import read_cycles

    _conclude(read_cycles(file, clock_mhz), name or out.stem, out)


def _conclude(steps: "Sequence[TimedStep]", name: str, out: Path) -> None:
    """Write the processor of `steps` to `out`, and print how well it fits.

    Raises:
        SettingsError: If there are too few problem sizes, or `out` cannot be written.
    """
    from rich.console import Console

    from prefcal_env.mpc.processors import fit_error, fit_processor, write_processor
    from prefcal_scenarios.cases.overtake import overtake
    from prefcal_scenarios.cases.overtake.computation_time import t_comp

    processor = fit_processor(name, steps)
    low, high = fit_error(processor, steps)
    write_processor(processor, out)
    theta = overtake.references[_PAPER]
    worst = float(t_comp(overtake.run(theta), processor).max())
    verdict = "in real time" if worst <= theta[0] else "too slow"
    console = Console(highlight=False, soft_wrap=True)
    console.print(f"Processor {name!r} from {len(steps)} steps: {out}", markup=False)
    console.print(f"90 % of the steps took {low:.2f} to {high:.2f} times the modeled time.")
    console.print(
        f"The paper's θ takes up to {1e3 * worst:.3g} ms per step, and T_s is "
        f"{1e3 * theta[0]:.0f} ms: {verdict}."
    )
    console.print(f"Use it: prefcal calibrate overtake --processor {out}", markup=False)
