"""`prefcal calibrate`: run one study and write its report."""

import sys
from typing import Any

import typer

from .options import Options
from .parameters import given, takes

EPILOG = """\
[bold]Examples[/bold]

[cyan]prefcal calibrate cstr[/cyan]
  The paper's reactor: 1,000 experiments are simulated unseen, and a page asks 10
  to 13 times which of two is better.

[cyan]prefcal calibrate cstr --study mine[/cyan]
  The same in a study called mine; the same command resumes it.

[cyan]prefcal calibrate cstr --terminal[/cyan]
  Answer in this terminal, on a machine without a browser.

[cyan]prefcal calibrate cstr --calibrator synthetic --seed 7 --out reactor[/cyan]
  Unattended: a synthetic calibrator answers; the report goes to reactor.

[cyan]prefcal calibrate cstr --start "T_s=0.5, N_p=30, log_Q=-1"[/cyan]
  Start from your current tuning: the first experiment runs it.

[cyan]prefcal calibrate cstr --from mine --study second[/cyan]
  For another person or a similar plant: try the best θ of the study mine early.

[cyan]prefcal calibrate cstr --simulate 0[/cyan]
  Run only what is shown: 50 experiments, with the agent glisp.

[cyan]prefcal calibrate cstr --agent glisp-paper[/cyan]
  The algorithm as published, without the additions of this project.

[cyan]prefcal calibrate cstr --agent glis[/cyan]
  What optimization finds when it sees the scenario's score.

[cyan]prefcal calibrate cstr --agent glis --cost mine_index.py:cost[/cyan]
  Unattended, scored by the cost learned from your answers (`prefcal studies index`).

[cyan]prefcal calibrate overtake --config traffic.json[/cyan]
  The overtaking on a wider road, among highway-env's drivers (see docs/overtaking.md).

[cyan]prefcal calibrate own.py:plant --agent random --n-max 20[/cyan]
  Your own scenario, simulated or a rig that you run yourself; random search.

[cyan]prefcal calibrate loop.fmu --knob "K_p=0.1:50:log" --reference level=2[/cyan]
  An FMU with a controller in it, exported from Simulink, Modelica or Dymola.

[cyan]prefcal calibrate pid --plant model.py:plant[/cyan]
  A PID on your own plant; knobs, set point and duration are found.

[cyan]prefcal calibrate tank.toml[/cyan]
  A scenario in a short file (`prefcal new` writes one).

[cyan]prefcal calibrate cstr --host 0.0.0.0 --no-browser[/cyan]
  Answer from another machine: prints a link for it.
"""


@takes(Options)
def calibrate(**typed: Any) -> None:
    """Tune SCENARIO by comparing experiments, and write a report.

    prefcal proposes θ, runs the experiment, shows it next to the best so far on a
    local page, and learns from your answer. If experiments are quick simulations,
    it simulates many θ unseen (--simulate) and shows only a few. A synthetic
    calibrator can answer instead. Every answer is saved before the next question. Ctrl-C stops and
    writes a report of the comparisons so far; the same --study resumes.
    """
    found = given(Options, typed)
    if sys.stderr.isatty():  # the next imports take a second
        name = str(found["scenario"]).partition("{")[0].strip()
        print(f"Loading {name} ...", file=sys.stderr, flush=True)
    # Imported here to keep --help fast.
    from .calibrate_run import run

    raise typer.Exit(run(found))
