"""Run `prefcal verify`: vary the plant of a tuning, say and keep what came of it, ask about the worst."""

import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from rich.console import Console
from rich.table import Table

from prefcal_app.report.verifying import judge, picture, verify_best
from prefcal_app.terminal.lines import ask_line
from prefcal_app.terminal.showing import say
from prefcal_env.errors import SettingsError
from prefcal_scenarios.verification.verified import EFFECTS, FILE, Verified

from .options import VerifyOptions
from .report import plain

_VERDICTS = {"y": True, "n": False}


def run(options: VerifyOptions) -> int:
    """Verify the tuning; return the exit code.

    Raises:
        PrefcalError: If the file or an option does not fit, or nothing of the scenario can vary.
    """
    best, console = Path(options.best), Console(emoji=False)
    said = verify_best(
        best,
        options.runs,
        ranges=dict(_range(text) for text in options.range),
        jobs=options.jobs,
        timeout=options.run_timeout,
        progress=True,
    )
    show(said, console)
    for k in range(len(said.worst)):
        drawn = best.parent / picture(k)
        where = drawn if drawn.is_file() else "could not be run again to draw it"
        say(console, f"Worst run {k + 1}, beside the nominal one: {where}")
    if sys.stdin.isatty():
        _ask(said, best.parent, console)
    say(console, f"Kept in {best.parent / FILE}.")
    return 0


def _range(text: str) -> tuple[str, float | list[float]]:
    """Return name and change of "dead time=0:0.5" or "parameter=0.2"."""
    name, _, change = (part.strip() for part in text.partition("="))
    try:
        ends = [float(end) for end in change.split(":")]
    except ValueError:
        ends = []
    if not name or len(ends) not in (1, 2):
        raise SettingsError(f'--range must look like parameter=0.2 or "dead time=0:0.5", got {text!r}')
    return name, ends[0] if len(ends) == 1 else ends


def _ask(said: Verified, folder: Path, console: Console) -> None:
    """Ask a person about the worst runs, and keep each verdict."""
    for k, each in enumerate(said.worst):
        told = ask_line(console, f"Worst run {k + 1} ({each.words}): acceptable? (y/n)").lower()
        if told in _VERDICTS:
            judge(folder, k, acceptable=_VERDICTS[told])


def show(said: Verified, console: Console) -> None:
    """Print a verification in a terminal."""
    say(console, said.statement, said.limits_kept)
    console.print(_table(said.kpi_columns, said.kpis))
    if said.margins:
        console.print(_table(said.margin_columns, said.margins))
    for line in _lines(said):
        say(console, line)


def _lines(said: Verified) -> Iterator[str]:
    """Yield what hurts most, the worst runs, and what was not varied."""
    yield _sentence(said.basis)
    if said.effects:  # they come after all random runs, and an interruption may end before
        yield "What hurts most, one at a time:"
    yield from (f"  {text}" for text in said.effects[:EFFECTS])
    if said.worst:
        yield "Worst runs:"
    for each in said.worst:
        yield f"  {each.words}: {each.text}"
    if said.varied:
        yield f"Varied: {', '.join(said.varied)}."
    yield from map(_sentence, said.left_out)


def _sentence(text: str) -> str:
    return f"{text[:1].upper()}{text[1:]}."


def _table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> Table:
    table = Table(*map(plain, columns), box=None, header_style="bold")
    for row in rows:
        table.add_row(*map(plain, row))
    return table
