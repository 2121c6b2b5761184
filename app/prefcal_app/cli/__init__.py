"""Run the command line `prefcal`; agents, plants and plots are imported only when needed."""

import logging
import os
import re
import sys
from typing import Annotated

import typer

from .calibrate import EPILOG, calibrate
from .check import EPILOG as CHECK_EPILOG
from .check import check
from .look import EPILOG as LOOK_EPILOG
from .look import look
from .starters.new import EPILOG as NEW_EPILOG
from .starters.new import new
from .studies.commands import REPORT_EPILOG, report
from .studies.commands import app as studies

app = typer.Typer(
    name="prefcal",
    help="Tune a controller by comparing experiments: you say which one went better.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
)
app.command(epilog=EPILOG)(calibrate)
app.command(no_args_is_help=True, epilog=NEW_EPILOG)(new)
app.command(no_args_is_help=True, epilog=CHECK_EPILOG)(check)
app.command(no_args_is_help=True, epilog=LOOK_EPILOG)(look)
app.command(epilog=REPORT_EPILOG)(report)
app.add_typer(studies)


def _version(asked: bool) -> None:
    if asked:
        from prefcal_app.report.export import versions

        typer.echo(f"prefcal {versions()['prefcal']}")
        raise typer.Exit


@app.callback()
def _common(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Tune a controller by comparing experiments: you say which one went better."""
    _one_thread()  # before any command imports numpy, which reads the environment once


def _one_thread() -> None:
    """Limit linear algebra to one thread unless the user has set another number.

    The matrices are small: with more threads the work takes twice as much processor time, most
    of it spent waiting.
    """
    for library in ("OPENBLAS", "OMP", "MKL"):
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")


@app.command()
def scenarios(
    name: Annotated[
        str | None, typer.Argument(metavar="[SCENARIO]", help="Scenario to describe: task, knobs and KPIs.")
    ] = None,
) -> None:
    """List the scenarios that `prefcal calibrate` knows by name, or describe one."""
    from prefcal_scenarios.catalog import load
    from prefcal_scenarios.names import BUILT_IN, CLOSED_LOOPS

    if name is not None:
        from rich.console import Console

        from prefcal_app.terminal.showing import show_brief
        from prefcal_app.view.brief import scenario_view

        show_brief(scenario_view(load(name)), Console(emoji=False))
        return
    cases = [known for known in BUILT_IN if known not in CLOSED_LOOPS]
    width = max(map(len, cases)) + 2
    for known in cases:
        scenario = load(known)
        typer.echo(f"{known:<{width}}{scenario.title}; knobs {', '.join(scenario.space.names)}")
    typer.echo(f"Closed loops: {', '.join(CLOSED_LOOPS)} (`prefcal scenarios servo` describes one)")
    typer.echo("Random closed loops: loop-1, loop-2, ... (any seed)")
    typer.echo("Your own: path/to/own.py:name, where name is a prefcal_scenarios.Scenario.")


def main() -> None:
    """Run the command line; an error of the caller becomes one line and exit code 2."""
    says = logging.getLogger("prefcal")
    says.setLevel(logging.INFO)
    says.handlers = [_Said()]
    try:
        code = app(standalone_mode=False)
    except (KeyboardInterrupt, typer.Abort):
        _complain("interrupted")
        sys.exit(130)
    except Exception as error:
        # Everything, since the classes to expect are imported only here, to keep --help fast, and
        # the parser's differ between versions. What is unknown is raised again.
        from prefcal_env.errors import PrefcalError

        known = isinstance(error, PrefcalError)
        wrong = (str(error), 2) if known else _wrong_call(error) or _own(error)
        if wrong is None:
            raise
        if wrong[0]:
            _complain(wrong[0])
        sys.exit(wrong[1])
    sys.exit(code if isinstance(code, int) else 0)


def _own(error: Exception) -> tuple[str, int] | None:
    """Return the message and exit code for an error of the user's own code; None for others."""
    from prefcal_env.own_line import in_words, located, own_line

    return (in_words(located(error)), 1) if own_line(error) else None


class _Said(logging.Handler):
    """Print what a part says while it works."""

    def emit(self, record: logging.LogRecord) -> None:
        """Print one message."""
        _complain(record.getMessage())


def _complain(words: str) -> None:
    """Print an error message on standard error."""
    # Imported here to keep --help fast.
    from prefcal_scenarios.presentation.wording import printable_lines

    print(f"prefcal: {printable_lines(words)}", file=sys.stderr, flush=True)


_MISSING = {
    "SCENARIO": "name a scenario: {scenarios}, or your own as path/to/own.py:NAME",
    "STUDY": "name a study: `prefcal studies list` shows yours",
    "OLD": "name the study to rename and its new name: `prefcal studies list` shows yours",
    "NEW": "give the new name, too",
    "FILE": "name the exported file",
    "KIND": "name a kind of starter: function, pid, controller, mpc, fmu or rig",
    "RUN RUN ...": "name two runs or more: CSV or Parquet files, or STUDY:3",
    "AGENT": "name an agent, or your own as path/to/own.py:Agent",
}
"""Messages for missing arguments, by placeholder."""
_PLAINER = (
    (r"^invalid value for '(.+?)': (?:value error, )?", r"\1: "),
    (r"input should be a (valid )?(\w+), unable to parse.*", r"expected an \2"),
    (r"expected an number", "expected a number"),
    (r"^no such option: (\S+) \(possible options: ([^,)]+).*\)", r"no such option: \1. Did you mean \2?"),
    (r"^got unexpected extra arguments? \((.*)\)", r"too many arguments: \1"),
    (r"^got unexpected extra argument\(s\) \((.*)\)", r"too many arguments: \1"),
    (r"^option '(.+?)' requires an argument", r"\1 needs a value"),
)
"""Phrases of the argument parser and their replacements."""


def _wrong_call(error: Exception) -> tuple[str, int] | None:
    """Return the message and exit code for an error of the argument parser; None for others.

    The message is empty if help was already printed. The parser's errors are recognized by their
    attributes, since their classes differ between versions.
    """
    format_message = getattr(error, "format_message", None)
    if format_message is None:
        return None
    code = int(getattr(error, "exit_code", 2))
    if type(error).__name__ == "NoArgsIsHelpError":
        return "", code
    context = getattr(error, "ctx", None)
    words = _missing(error) or _sentence(str(format_message()), context)
    command = getattr(context, "command_path", "prefcal")
    return f"{words} (help: {command} --help)", code


def _missing(error: Exception) -> str:
    """Return the message for a missing argument; empty for any other error."""
    if type(error).__name__ != "MissingParameter":
        return ""
    from prefcal_scenarios.names import NAMES

    parameter = getattr(error, "param", None)
    words = _MISSING.get(str(getattr(parameter, "metavar", "")), "")
    return words.format(scenarios=NAMES)


def _sentence(words: str, context: object) -> str:
    """Return `words` in our style, with the list of commands if one was misspelled."""
    words = " ".join(words.split()).rstrip(".")
    words = words[:1].lower() + words[1:]
    for phrase, plainer in _PLAINER:
        words = re.sub(phrase, plainer, words, flags=re.IGNORECASE)
    commands = getattr(getattr(context, "command", None), "commands", {})
    if words.startswith("no such command") and "Did you mean" not in words:
        words += f": expected one of {', '.join(commands)}"
    return words
