"""Run the command line `prefcal`; agents, plants and plots are imported only when needed.

What does not fit (an option, a study, a scenario, the machine) raises a `PrefcalError` wherever it is
found in this package. `main` prints it as one line.
"""

import errno
import logging
import re
import signal
import sys
from collections.abc import Callable
from typing import Any

import typer

from .commands import app as app

_DENIED = ["ENAMETOOLONG", "ENOSPC", "EDQUOT", "EACCES", "EPERM", "EROFS", "EIO", "ELOOP", "EISDIR", "EMFILE"]
"""Errors of a system that refuses a file: no fault of ours, so that no traceback helps."""


def main() -> None:
    """Run the command line; an error of the caller becomes one line and exit code 2."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        # A script's "&" hands this down: Python then hears no Ctrl-C, which every command says that it heeds.
        signal.signal(signal.SIGINT, signal.default_int_handler)
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
        wrong = (str(error), 2) if known else _wrong_call(error) or _own(error) or _of_the_system(error)
        if wrong is None:
            raise
        if wrong[0]:
            _complain(wrong[0])
        sys.exit(wrong[1])
    sys.exit(code if isinstance(code, int) else 0)


def _own(error: Exception) -> tuple[str, int] | None:
    """Return the message and exit code for an error of the user's own code; None for others."""
    from prefcal_env.wording import in_words, locate, own_line

    return (in_words(locate(error)), 1) if own_line(error) else None


def _of_the_system(error: Exception) -> tuple[str, int] | None:
    """Return the message and exit code if the system refuses a file: a full disk, rights, a long name."""
    if not isinstance(error, OSError) or errno.errorcode.get(error.errno or 0) not in _DENIED:
        return None
    name = "" if error.filename is None else f": {str(error.filename)!r:.80}"
    return f"{(error.strerror or str(error)).lower()}{name}", 1


class _Said(logging.Handler):
    """Print what a part says while it works."""

    def emit(self, record: logging.LogRecord) -> None:
        """Print one message."""
        _complain(record.getMessage())


def _complain(words: str) -> None:
    """Print an error message on standard error."""
    # Imported here to keep --help fast.
    from prefcal_scenarios.wording import printable_lines

    print(f"prefcal: {printable_lines(words)}", file=sys.stderr, flush=True)


_MISSING = {
    "SCENARIO": "name a scenario: {scenarios}, or your own as path/to/own.py:NAME",
    "STUDY": "name a study: `prefcal studies list` shows yours",
    "OLD": "name the study to rename and its new name: `prefcal studies list` shows yours",
    "NEW": "give the new name, too",
    "FILE": "name the exported file",
    "RUN RUN ...": "name two runs or more: CSV, Parquet or Excel files, or STUDY:3",
    "AGENT": "name an agent, or your own as path/to/own.py:Agent",
}
"""Messages for missing arguments, by placeholder."""


def _beyond(found: re.Match[str]) -> str:
    """Return which limit a number is beyond, where the parser states both."""
    value, low, high = found.groups()
    below = low is not None and float(value) < float(low)
    return f" must be {f'at least {low}' if below else f'at most {high}'}, got {value}"


_PLAINER: tuple[tuple[str, str | Callable[[re.Match[str]], str]], ...] = (
    (r"^invalid value for '(.+?)': (?:value error, )?", r"\1: "),
    # Newer versions of typer ask pydantic, older ones click: both must say the same.
    (r": input should be a (?:valid )?(\w+), unable to parse.*", r": expected an \1"),
    (r": '(.*)' is not a valid (integer|float)(?: range)?$", r": expected an \2, got \1"),
    (r"expected an (?:number|float)", "expected a number"),
    (r": (\S+) is not in the range x>=(\S+)$", r" must be at least \2, got \1"),
    (r": (\S+) is not in the range (?:(\S+)<=)?x(?:<=(\S+))?$", _beyond),
    (r": input should be greater than or equal to (\S+)", r" must be at least \1"),
    (r": input should be less than or equal to (\S+)", r" must be at most \1"),
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
    words = ""
    if type(error).__name__ == "MissingParameter":
        from prefcal_scenarios.names import NAMES

        parameter = getattr(error, "param", None)
        words = _MISSING.get(str(getattr(parameter, "metavar", "")), "").format(scenarios=NAMES)
    words = words or _sentence(str(format_message()), context)
    words += _got(error, words)
    return f"{words} (help: {getattr(context, 'command_path', 'prefcal')} --help)", code


def _got(error: Exception, words: str) -> str:
    """Return the value that was refused, unless `words` have it: newer versions of typer hide it."""
    errors: Callable[[], list[Any]] = getattr(error.__cause__, "errors", list)
    return "".join(f", got {each['input']}" for each in errors()[:1] if repr(each["input"]) not in words)


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
