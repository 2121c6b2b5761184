"""What `prefcal check` does and prints."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text

from prefcal_env.errors import SettingsError
from prefcal_scenarios.checkup import Checkup, Finding, middle_of
from prefcal_scenarios.cli.choices import start_of
from prefcal_scenarios.isolated import DEFAULT_LIMIT, isolation
from prefcal_scenarios.own_line import in_words, located
from prefcal_scenarios.report.folder import folder_for, put
from prefcal_scenarios.report.wording import printable, theta_text
from prefcal_scenarios.scenario import Scenario, load

_SIGNS = {True: ("✓", "green"), False: ("✗", "bold red"), None: ("·", "dim")}
_FIRST = " (the very first run on a machine compiles for half a minute)"


@dataclass(frozen=True, slots=True)
class Wanted:
    """The options of `prefcal check`.

    Args:
        theta: What to run, as a person writes it; None: the middle of the box.
        seed: Seed of the run.
        out: File of the picture; None: check-NAME.png.
        open: Whether the picture is opened.
        json: Whether standard output is for a program.
        run_timeout: Most seconds of a run of an own scenario.
    """

    theta: str | None = None
    seed: int = 0
    out: Path | None = None
    open: bool = False
    json: bool = False
    run_timeout: float = DEFAULT_LIMIT


def run_check(source: str, wanted: Wanted) -> int:
    """Check the scenario called `source`, print what was found; 1 if anything is wrong, else 0.

    Raises:
        SettingsError: a θ or a file that cannot be.
    """
    with isolation(source, wanted.run_timeout) as isolated:
        return _check(source, wanted, isolated)


def _check(source: str, wanted: Wanted, isolated: Callable[[Scenario], Scenario]) -> int:
    messages = Console(stderr=True)
    try:
        scenario = isolated(load(source))
        theta = middle_of(scenario) if wanted.theta is None else None
    except Exception as error:  # of an own file: a finding like any other
        return _end(source, None, [Finding("scenario", False, in_words(located(error)))], wanted)
    if theta is None:
        assert wanted.theta is not None
        theta = start_of(wanted.theta, scenario)
    picture = _file_for(scenario, wanted.out)
    checkup = Checkup(scenario, theta, wanted.seed)
    with messages.status("") as status:
        for words, step in checkup.steps():
            status.update(f"{words} …{_FIRST if words == 'running θ' else ''}")
            step()
        status.update("drawing …")
        drawn = _draw(checkup, picture)
    if drawn and wanted.open:
        typer.launch(str(picture))
    return _end(source, checkup, checkup.findings, wanted, picture if drawn else None)


def _file_for(scenario: Scenario, out: Path | None) -> Path:
    path = Path(f"check-{scenario.name}.png") if out is None else out
    if path.suffix.lower() != ".png":
        raise SettingsError(f"out must be a file that ends in .png, got {str(path)!r}")
    folder_for(path.parent)
    return path


def _draw(checkup: Checkup, path: Path) -> bool:
    """Draw the panels of the trial run; whether there is a picture."""
    experiment = checkup.experiment
    if experiment is None or not len(experiment.t) or checkup.is_rig:
        return False
    # Here, not above: plots take half a second to load.
    from io import BytesIO

    from prefcal_scenarios.report.style import save
    from prefcal_scenarios.report.trajectories import alone

    buffer = BytesIO()
    try:
        save(alone(checkup.scenario, experiment), buffer)
        put(path, buffer.getvalue())
    except Exception as error:
        checkup.findings.append(Finding("picture", False, in_words(located(error))))
        return False
    return True


def _end(
    source: str,
    checkup: Checkup | None,
    findings: list[Finding],
    wanted: Wanted,
    picture: Path | None = None,
) -> int:
    """Print the result; the exit code."""
    failures = [f for f in findings if f.ok is False]
    if wanted.json:
        print(json.dumps(_as_dict(source, checkup, findings, picture)), flush=True)
        return int(bool(failures))
    console = Console()
    if checkup is not None:
        title = Text(printable(checkup.scenario.title), style="bold")
        console.print(title, Text(theta_text(checkup.scenario.space, checkup.theta)), sep="\n")
    table = Table.grid(padding=(0, 2, 0, 0))
    table.add_column(no_wrap=True)
    table.add_column(overflow="fold", max_width=28)
    table.add_column(overflow="fold")
    for f in findings:
        sign, style = _SIGNS[f.ok]
        words = Text(printable(f.words), style="" if f.ok is not None else "dim")
        table.add_row(Text(sign, style=style), Text(printable(f.what)), words)
    console.print(table)
    if picture is not None:
        console.print(f"Picture: {picture}", soft_wrap=True, markup=False, highlight=False)
    ran = checkup is not None and checkup.experiment is not None
    verdict = _verdict(source, len(failures), len(findings), ran=ran)
    console.print(verdict, soft_wrap=True, markup=False, highlight=False)
    return int(bool(failures))


def _verdict(source: str, wrong: int, count: int, *, ran: bool) -> str:
    if wrong and not ran:
        return "Nothing else can be checked without a run: mend this and check again."
    if wrong:
        return f"{wrong} of {count} checks failed: mend what is marked ✗ and check again."
    return f"All in order. Begin with: prefcal calibrate {source}"


def _as_dict(
    source: str, checkup: Checkup | None, findings: list[Finding], picture: Path | None
) -> dict[str, Any]:
    theta = None if checkup is None else checkup.scenario.space.named(checkup.theta)
    return {
        "ok": not any(f.ok is False for f in findings),
        "scenario": source,
        "theta": theta,
        "checks": [{"what": f.what, "ok": f.ok, "words": f.words} for f in findings],
        "picture": None if picture is None else str(picture),
    }
