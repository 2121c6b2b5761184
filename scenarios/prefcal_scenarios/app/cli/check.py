"""`prefcal check`: check a scenario with one trial run before a study."""

import json as json_
import shlex
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .describing.options import (
    KnobOption,
    PlantOption,
    ReferenceOption,
    ShowOption,
    StopTimeOption,
)
from .parameters import given, takes

if TYPE_CHECKING:
    from prefcal_scenarios.scenario import Scenario

    from .checkup import Checkup, Finding

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

_SIGNS = {True: ("✓", "green"), False: ("✗", "bold red"), None: ("·", "dim")}
_FIRST = " (the very first run on a machine compiles for half a minute)"


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
    from prefcal_scenarios.app.isolated import isolation

    from .describing.source import source_of

    options = given(CheckOptions, typed)
    said = {name: value for name, value in options.items() if value is not None}
    wanted = CheckOptions(**{**said, "scenario": source_of(options)})
    with isolation(wanted.scenario, wanted.run_timeout) as isolated:
        raise typer.Exit(_check(wanted, isolated))


def _check(wanted: CheckOptions, isolated: "Callable[[Scenario], Scenario]") -> int:
    """Check the scenario and print the findings; return 1 if anything is wrong, else 0.

    Raises:
        SettingsError: If θ or the file of the picture is invalid.
    """
    from rich.console import Console

    from prefcal_scenarios.own.own_line import in_words, located
    from prefcal_scenarios.scenario import load

    from .checkup import Checkup, Finding, middle_of
    from .choices import start_of

    try:
        scenario = isolated(load(wanted.scenario))
        theta = middle_of(scenario) if wanted.theta is None else None
    except Exception as error:  # raised by the user's file: report it as a finding
        return _end(wanted, None, [Finding("scenario", False, in_words(located(error)))], None)
    if theta is None:
        assert wanted.theta is not None
        theta = start_of(wanted.theta, scenario)
    picture = _file_for(scenario, wanted.out)
    checkup = Checkup(scenario, theta)
    with Console(stderr=True, emoji=False).status("") as status:
        for words, step in checkup.steps():
            status.update(f"{words} …{_FIRST if words == 'running θ' else ''}")
            step()
        status.update("drawing …")
        drawn = _draw(checkup, picture)
    return _end(wanted, checkup, checkup.findings, picture if drawn else None)


def _file_for(scenario: "Scenario", out: Path | None) -> Path:
    """Return the file of the picture. Raises SettingsError if it cannot be written."""
    from prefcal_scenarios.app.presentation.folder import picture_at

    return picture_at(f"check-{scenario.name}.png" if out is None else out)


def _draw(checkup: "Checkup", path: Path) -> bool:
    """Draw the panels of the trial run; return whether there is a picture."""
    experiment = checkup.experiment
    if experiment is None or not len(experiment.t) or checkup.is_rig:
        return False
    # Imported here: plotting takes half a second to import.
    from io import BytesIO

    from prefcal_scenarios.app.presentation.folder import put
    from prefcal_scenarios.app.presentation.style import save
    from prefcal_scenarios.app.report.trajectories import alone
    from prefcal_scenarios.own.own_line import in_words, located

    from .checkup import Finding

    buffer = BytesIO()
    try:
        save(alone(checkup.scenario, experiment), buffer)
        put(path, buffer.getvalue())
    except Exception as error:  # panels are the user's code: they can raise anything
        checkup.findings.append(Finding("picture", False, in_words(located(error))))
        return False
    return True


def _end(
    wanted: CheckOptions,
    checkup: "Checkup | None",
    findings: "list[Finding]",
    picture: Path | None,
) -> int:
    """Print the result; return the exit code."""
    failed = sum(finding.ok is False for finding in findings)
    if wanted.json:
        print(json_.dumps(_as_dict(wanted.scenario, checkup, findings, picture)), flush=True)
        return int(bool(failed))
    _print_findings(checkup, findings)
    from rich.console import Console

    console = Console(emoji=False)
    if picture is not None:
        console.print(f"Picture: {picture}", soft_wrap=True, markup=False, highlight=False)
    ran = checkup is not None and (checkup.experiment is not None or checkup.is_live)
    verdict = _verdict(wanted.scenario, failed, sum(f.ok is not None for f in findings), ran=ran)
    console.print(verdict, soft_wrap=True, markup=False, highlight=False)
    return int(bool(failed))


def _print_findings(checkup: "Checkup | None", findings: "list[Finding]") -> None:
    """Print the scenario and θ, and a line for each check."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    from prefcal_scenarios.app.presentation.wording import printable, theta_text

    console = Console(emoji=False)
    if checkup is not None:
        title = Text(printable(checkup.scenario.title), style="bold")
        console.print(title, Text(theta_text(checkup.scenario.space, checkup.theta)), sep="\n")
    table = Table.grid(padding=(0, 2, 0, 0))
    table.add_column(no_wrap=True)
    table.add_column(overflow="fold", max_width=28)
    table.add_column(overflow="fold")
    for finding in findings:
        sign, style = _SIGNS[finding.ok]
        lines = "\n".join(map(printable, finding.words.splitlines()))
        words = Text(lines, style="" if finding.ok is not None else "dim")
        table.add_row(Text(sign, style=style), Text(printable(finding.what)), words)
    console.print(table)


def _verdict(source: str, wrong: int, count: int, *, ran: bool) -> str:
    if wrong and not ran:
        return "Nothing else can be checked without a run: fix this and check again."
    if wrong:
        return f"{wrong} of {count} checks failed: fix what is marked ✗ and check again."
    from prefcal_scenarios.own.described.options import words_of

    command = shlex.join(["prefcal", "calibrate", *words_of(source)])
    return f"All in order. Start with: {command}"


def _as_dict(
    source: str, checkup: "Checkup | None", findings: "list[Finding]", picture: Path | None
) -> dict[str, Any]:
    theta = None if checkup is None else checkup.scenario.space.named(checkup.theta)
    return {
        "ok": not any(f.ok is False for f in findings),
        "scenario": source,
        "theta": theta,
        "checks": [{"what": f.what, "ok": f.ok, "words": f.words} for f in findings],
        "picture": None if picture is None else str(picture),
    }
