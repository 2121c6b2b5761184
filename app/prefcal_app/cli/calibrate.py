"""`prefcal calibrate`: run one study and write its report."""

import sys
from typing import Any

import typer

from .options import Options
from .parameters import examples, given, takes

EPILOG = examples(
    (
        "calibrate cstr",
        "The paper's reactor: 1,000 experiments are simulated unseen, and a page asks 10 to 13 "
        "times which of two is better.",
    ),
    ("calibrate cstr --study mine", "The same in a study called mine; run it again to resume."),
    ("calibrate cstr --terminal", "Answer in this terminal, on a machine without a browser."),
    (
        "calibrate cstr --calibrator synthetic --seed 7 --out reactor",
        "Unattended: a synthetic calibrator answers; the report goes to reactor.",
    ),
    (
        'calibrate cstr --start "T_s=0.5, N_p=30, log_Q=-1"',
        "Start from your current tuning: the first experiment runs it.",
    ),
    ("calibrate cstr --simulate 0", "Run only what is shown: 50 experiments, with agent glisp."),
    ("calibrate cstr --agent glis --cost own.py:cost", "Unattended, scored by a function of yours."),
    ("calibrate own.py:plant", "Your own scenario, simulated or a rig that you run yourself."),
    (
        'calibrate loop.fmu --knob "K_p=0.1:50:log" --reference level=2',
        "An FMU with a controller in it, exported from Simulink, Modelica or Dymola.",
    ),
    (
        "calibrate pid --plant model.py:plant",
        "A PID on your own plant; knobs, set point and duration are found.",
    ),
    ("calibrate tank.toml", "A scenario in a short file (`prefcal new` writes one)."),
    ("calibrate cstr --host 0.0.0.0 --no-browser", "Answer from another machine, by a link."),
)


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
