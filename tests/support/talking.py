"""Conversations in the terminal, with a recorded console and typed keys."""

import io
from collections.abc import Iterable

from rich.console import Console

from prefcal_app.session import Background, Interview
from prefcal_app.terminal import converse
from prefcal_app.terminal.converse import ANSWER


def console_of(width: int = 140) -> Console:
    """A console that remembers what is printed."""
    return Console(file=io.StringIO(), width=width, record=True, force_terminal=False)


def talk(interview: Interview, keys: Iterable[str], lines: Iterable[str] = (), width: int = 140) -> str:
    """The conversation with these answers and other lines; what was printed."""
    console = console_of(width)
    typed, written = iter(keys), iter(lines)
    with Background(interview):
        converse(interview, console, lambda words: next(typed if words == ANSWER else written))
    return console.export_text()
