"""Declare the program `prefcal` and its commands, but for `new` and `studies`.

What they do is imported when they run, so that `prefcal --help` stays fast.
"""

import os
import sys
from typing import Annotated, Any

from typer import Argument, Context, Exit, Option, Typer, echo

from .options import (
    CHOOSING,
    CheckOptions,
    ChooseOptions,
    ExportOptions,
    IdentifyOptions,
    LookOptions,
    Options,
    ReportOptions,
    VerifyOptions,
)
from .parameters import examples, examples_of_worlds, parameters_of, takes
from .starters.new import EPILOG as NEW_EPILOG
from .starters.new import new
from .studies.commands import app as studies

app = Typer(
    name="prefcal",
    help="Tune a controller by comparing experiments: you say which one went better.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
)


def _version(asked: bool) -> None:
    if asked:
        from prefcal_app.report.export import versions

        echo(f"prefcal {versions()['prefcal']}")
        raise Exit


@app.callback()
def _common(
    version: Annotated[
        bool, Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Tune a controller by comparing experiments: you say which one went better."""
    # One thread for linear algebra unless the user has set another number, before any command imports
    # numpy, which reads the environment once. The matrices are small: with more threads the work takes
    # twice as much processor time, most of it spent waiting.
    for library in ("OPENBLAS", "OMP", "MKL"):
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")


@app.command(
    epilog=examples(
        (
            "calibrate cstr",
            "The paper's reactor: 1,000 experiments are simulated unseen, and a page asks up to ten "
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
        *examples_of_worlds("calibrate"),
        (
            "calibrate pid --plant model.py:plant",
            "A PID on your own plant; knobs, set point and duration are found.",
        ),
        ("calibrate pid --plant step.csv", "A PID on the plant that a record of a step test shows."),
        ("calibrate tank.toml", "A scenario in a short file (`prefcal new` writes one)."),
        ("calibrate cstr --host 0.0.0.0 --no-browser", "Answer from another machine, by a link."),
    )
)
@takes(Options)
def calibrate(typed: dict[str, Any]) -> None:
    """Tune SCENARIO by comparing experiments, and write a report.

    prefcal proposes θ, runs the experiment, shows it next to the best so far on a
    local page, and learns from your answer. If experiments are quick simulations,
    it simulates many θ unseen (--simulate) and shows only a few. A synthetic
    calibrator can answer instead. Every answer is saved before the next question. Ctrl-C stops and
    writes a report of the comparisons so far; the same --study resumes.
    """
    if sys.stderr.isatty():  # the next imports take a second
        name = str(typed["scenario"]).partition("{")[0].strip()
        print(f"Loading {name} ...", file=sys.stderr, flush=True)
    from .calibrate import run

    raise Exit(run(typed))


@app.command(
    no_args_is_help=True,
    epilog=examples(
        (
            "choose runs.csv --lower overshoot,settling",
            "Both count, and lower is better; all other columns are only shown.",
        ),
        ("choose runs.csv", "All columns of numbers count; your answers tell in which direction."),
        ("choose cars.xlsx --lower price --higher range --kpis length", "Of length, you show what you like."),
        ("choose runs.csv --study mine --terminal", "In this terminal; run it again to resume."),
        *examples_of_worlds("choose"),
        more="""\
The first line of a table holds headings, perhaps with units, as in "settling \\[s]". What
`trials_dataframe()` of Optuna exports is recognized: trials that failed are left out.
""",
    ),
)
@takes(ChooseOptions, *(parameters_of(Options)[name] for name in CHOOSING))
def choose(typed: dict[str, Any]) -> None:
    """Choose among runs that already ran: about ten questions find the row that you want.

    Nothing is run. Two rows of TABLE are shown at a time, and you say which one you would rather
    have. Ends with the best row and why, in a report and in best.json. Every answer is saved.
    """
    from .calibrate import choose as chosen

    raise Exit(chosen(typed))


app.command(no_args_is_help=True, epilog=NEW_EPILOG)(new)


@app.command(
    no_args_is_help=True,
    epilog=examples(
        ("identify step.csv", "Columns are guessed: time, what was stepped, what responded."),
        (
            "identify step.csv --input valve --output level --limits 0:100",
            "The valve moved the level, and may reach 0 to 100 in its unit.",
        ),
        more="""\
The plant must be at rest at the start, then the input steps, once or several
times, and nothing else changes. The column called time, or else a first one
that increases, is the time; headings may have units, as in "level \\[m]".
""",
    ),
)
@takes(IdentifyOptions)
def identify(typed: dict[str, Any]) -> None:
    """Find the plant that a record of a step test shows, and what the record leaves open.

    Prints its numbers with 90 % intervals, draws the model over the record, and
    keeps the plant in a file beside it, for `calibrate pid --plant`. `verify` and
    `--robust` vary the plant as far as the record leaves it open.
    """
    from .identify import run

    raise Exit(run(IdentifyOptions(**typed)))


@app.command(
    no_args_is_help=True,
    epilog=examples(
        ("check own.py:plant", "Your own scenario: the variable plant in the file own.py."),
        ('check own.py:plant --theta "K_p=2, K_i=0.1"', "The same at your current tuning, every knob given."),
        ("check cstr --out reactor.png", "A built-in scenario, with the picture in a file of your choice."),
        *examples_of_worlds("check"),
        ("check pid --plant model.py:plant", "A PID on your own plant."),
        ("check tank.toml", "A scenario in a short file (`prefcal new` writes one)."),
        more="""\
[bold]What you see[/bold]

✓ passed, ✗ failed (with what was expected), · for your information.
An error in your own code is shown with its last line there. Look at the picture
too: only you know whether the curves are those of your plant.
""",
    ),
)
@takes(CheckOptions)
def check(typed: dict[str, Any]) -> None:
    """Run SCENARIO once, check all that a study relies on, and draw its panels.

    The checks cover θ and how its run ended, the record, channels and panels, KPIs
    and their goals, the cost, the calibrators, the references, the controller,
    whether the same θ and seed give the same experiment, and whether a study can
    store it. Ends with exit code 1 if anything is wrong.
    """
    from .checkup import run

    raise Exit(run(typed))


@app.command(
    no_args_is_help=True,
    epilog=examples(
        (
            "look before.csv after.csv",
            "Both runs on one page: same axes, one cursor, KPIs with their differences.",
        ),
        (
            "look before.csv after.csv --reference level=2 --inputs valve",
            "With tracking errors of the level, and moves of the valve.",
        ),
        (
            'look a.csv b.csv --columns "level=TI-101.PV" --unit level=m',
            "A column of a historian under a name of your own.",
        ),
        ("look mine:3 mine:best plant.csv", "Experiments of the study mine, beside a record of the plant."),
        ("look a.csv b.csv --out pair.png", "The picture in a file, without a page."),
        ("look a.csv b.csv --json", "The KPIs of both, for programs."),
        more="""\
The column called time, or else a first one that increases, is the time, in
seconds or as time stamps. Headings may have units, as in "level \\[m]".
A column "level ref" is the reference of level. All other columns of numbers are outputs.
""",
    ),
)
@takes(LookOptions)
def look(typed: dict[str, Any]) -> None:
    """Show two or more runs beside each other, without a study.

    Runs may have different time bases, lengths and columns: columns of the same name and unit
    share a plot. Ctrl-C ends the page.
    """
    from .look_run import look_at

    raise Exit(look_at(LookOptions(**typed)))


@app.command(
    epilog=examples(
        ("report mine", "Write the report of the study called mine into the folder prefcal-mine."),
        (
            "report plant-1 --scenario own.py:plant --out latest",
            "For a study of your own scenario, into a folder of your choice.",
        ),
        ("report pid-1 --plant model.py:plant", "For a PID on your own plant."),
    )
)
@takes(ReportOptions)
def report(typed: dict[str, Any]) -> None:
    """Write the report of a study as it stands, complete or not."""
    from .calibrate import report_of

    report_of(typed)


@app.command(
    no_args_is_help=True,
    epilog=examples(
        ("verify prefcal-mine/best.json", "299 runs with plant, sensors, actuators and task varied."),
        (
            'verify best.json --range parameter=0.2 --range "dead time=0:0.5"',
            "Parameters up to 20 % off, and up to 50 % more dead time.",
        ),
        ('verify best.json --limit "overshoot <= 10 %"', "Judge by this limit, too."),
        more="""\
Ctrl-C ends the runs; those that are done are kept and reported. Fewer runs than
in verification.json do not replace it: they are shown and kept beside it. The
scenario is run again: one of your own is a Python file, which is executed.
""",
    ),
)
@takes(VerifyOptions)
def verify(typed: dict[str, Any]) -> None:
    """Run a tuning on plants that are not exactly as modeled.

    Prints two verdicts: how many runs hold, with what that shows and what to do next, and
    what margins the nominal loop has. Then KPIs beside those of the tuning before, what
    hurts most, and the worst runs, which it draws beside best.json and asks about. All of
    that is kept there in verification.json. Ends with exit code 0 whatever the result is.
    """
    from .look_run import verify

    raise Exit(verify(VerifyOptions(**typed)))


@app.command(
    no_args_is_help=True,
    epilog=examples(
        ("export prefcal-mine/best.json --to st --out pid.st", "A function block for a PLC."),
        ("export best.json --to c --name heater --out heater.h", "A C function heater, for any processor."),
        ("export best.json --to forms --time min", "Numbers to type in, with times in minutes."),
        (
            "export best.json --to forms --ranges 0:200,0:100",
            "With proportional band: 200 °C are the transmitter's range, 100 % the valve's.",
        ),
    ),
)
@takes(ExportOptions)
def export(typed: dict[str, Any]) -> None:
    """Write a tuned controller in the form of your control system.

    Structured text and C do sample by sample what the tuned controller does, with its limits,
    anti-windup and filter. Their constants hold for its sampling time only.
    """
    from .look_run import export

    export(ExportOptions(**typed))


@app.command()
def scenarios(
    name: Annotated[
        str | None, Argument(metavar="[SCENARIO]", help="Scenario to describe: task, knobs and KPIs.")
    ] = None,
) -> None:
    """List the scenarios that `prefcal calibrate` knows by name, or describe one."""
    from .checkup import describe, print_all

    if name is None:
        print_all()
    else:
        describe(name)


ELSEWHERE = {
    "reproduce": "Repeat the paper's case studies, and show its results and ours on one page.",
    "bench": "Compare agents on problems, and write tables and figures.",
}
"""Commands of the distribution prefcal-bench, and their help."""


def _hand_over(context: Context) -> None:
    """Run a command of the benchmark, or say on standard error what to install."""
    from typer.main import get_command

    from prefcal_env.optional import BENCHMARK, command

    name = str(context.info_name)
    found = command(name)
    if found is None:
        print(f"prefcal: {name} is a command of the benchmark: {BENCHMARK}", file=sys.stderr)
        raise Exit(2)
    program = get_command(found.load())
    with program.make_context(name, context.args, parent=context.parent) as inner:
        raise Exit(program.invoke(inner) or 0)


for _name, _help in ELSEWHERE.items():
    app.command(
        _name,
        help=_help,
        add_help_option=False,
        context_settings={"ignore_unknown_options": True, "allow_extra_args": True},
    )(_hand_over)
app.add_typer(studies)
