"""What `prefcal processor` does."""

from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.progress import track

from prefcal_env.mpc.processors import TimedStep, fit_error, fit_processor, write_processor
from prefcal_scenarios.overtake import overtake
from prefcal_scenarios.overtake.computing import t_comp
from prefcal_scenarios.overtake.cycles import read_cycles
from prefcal_scenarios.overtake.measuring import timed_steps

_PAPER = "paper, preferences"


def measure_here(rounds: int, name: str, out: Path) -> None:
    """Time the controller on this machine, with a progress bar, and write its processor to `out`.

    Raises:
        SettingsError: `out` cannot be written.
    """
    messages = Console(stderr=True)
    overtake.run(overtake.references[_PAPER])  # compiles, so that nothing compiled is timed
    steps = timed_steps(
        rounds, lambda thetas: track(list(thetas), "timing the controller", console=messages)
    )
    _conclude(steps, name, out)


def convert(file: Path, clock_mhz: float, name: str, out: Path) -> None:
    """Write the processor of the cycle counts in `file` to `out`.

    Raises:
        SettingsError: a bad file, too few problem sizes, or `out` cannot be written.
    """
    _conclude(read_cycles(file, clock_mhz), name, out)


def _conclude(steps: Sequence[TimedStep], name: str, out: Path) -> None:
    processor = fit_processor(name, steps)
    low, high = fit_error(processor, steps)
    write_processor(processor, out)
    theta = overtake.references[_PAPER]
    worst = float(t_comp(overtake.run(theta), processor).max())
    verdict = "in real time" if worst <= theta[0] else "too slow"
    console = Console(highlight=False, soft_wrap=True)
    console.print(f"Processor {name!r} from {len(steps)} steps: {out}", markup=False)
    console.print(f"90 % of the steps took {low:.2f} to {high:.2f} of the modelled time.")
    console.print(
        f"The paper's θ takes {1e3 * worst:.3g} ms a step at worst, T_s is "
        f"{1e3 * theta[0]:.0f} ms: {verdict}."
    )
    console.print(f"Use it: prefcal calibrate overtake --processor {out}", markup=False)
