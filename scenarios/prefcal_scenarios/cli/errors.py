"""One look for every error of the command line: one line, `prefcal: what is wrong`."""

import re
import sys

_MISSING = {
    "SCENARIO": "name a scenario: {scenarios}, or your own as path/to/own.py:NAME",
    "STUDY": "name a study: `prefcal studies list` shows yours",
    "OLD": "name the study to rename and its new name: `prefcal studies list` shows yours",
    "NEW": "give the new name, too",
    "FILE": "name the exported file",
}


def complain(words: str) -> None:
    """Print one error for people on standard error."""
    print(f"prefcal: {words}", file=sys.stderr)


def wrong_call(error: Exception) -> tuple[str, int] | None:
    """Return the message and the exit code of an error of the argument parser.

    None for every other error. An empty message: the help is on the screen already.

    Told apart by what they offer, since their classes move between versions of the parser.
    """
    told = getattr(error, "format_message", None)
    if told is None:
        return None
    code = int(getattr(error, "exit_code", 2))
    if type(error).__name__ == "NoArgsIsHelpError":
        return "", code
    context = getattr(error, "ctx", None)
    words = _missing(error) or _sentence(str(told()), context)
    command = getattr(context, "command_path", "prefcal")
    return f"{words} (help: {command} --help)", code


def _missing(error: Exception) -> str:
    """What to say about an argument that is not there; empty for any other error."""
    if type(error).__name__ != "MissingParameter":
        return ""
    from prefcal_scenarios.scenario import BUILT_IN

    parameter = getattr(error, "param", None)
    words = _MISSING.get(str(getattr(parameter, "metavar", "")), "")
    return words.format(scenarios=", ".join(BUILT_IN))


_PLAINER = (
    (r"^invalid value for '(.+?)': (?:value error, )?", r"\1: "),
    (r"input should be a (valid )?(\w+), unable to parse.*", r"expected an \2"),
    (r"expected an number", "expected a number"),
    (
        r"^no such option: (\S+) \(possible options: ([^,)]+).*\)",
        r"no such option: \1. Did you mean \2?",
    ),
    (r"^got unexpected extra arguments? \((.*)\)", r"too many arguments: \1"),
    (r"^got unexpected extra argument\(s\) \((.*)\)", r"too many arguments: \1"),
    (r"^option '(.+?)' requires an argument", r"\1 needs a value"),
)
"""The parser's phrases, and what we say instead."""


def _sentence(words: str, context: object) -> str:
    """`words` in our style; with the commands that exist if one was misspelled."""
    words = " ".join(words.split()).rstrip(".")
    words = words[:1].lower() + words[1:]
    for phrase, plainer in _PLAINER:
        words = re.sub(phrase, plainer, words, flags=re.IGNORECASE)
    commands = getattr(getattr(context, "command", None), "commands", {})
    if words.startswith("no such command") and "Did you mean" not in words:
        words += f": expected one of {', '.join(commands)}"
    return words
