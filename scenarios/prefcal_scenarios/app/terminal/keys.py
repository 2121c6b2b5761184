"""Read what the person types: single keys in a terminal, lines from a file or a pipe."""

import os
import select
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import click
from rich.console import Console

LEFT, RIGHT, DOWN = "\x1b[D", "\x1b[C", "\x1b[B"
ARROWS = {LEFT: "l", RIGHT: "r", DOWN: "=", "\x1bOD": "l", "\x1bOC": "r", "\x1bOB": "=",
          "\xe0K": "l", "\xe0M": "r", "\xe0P": "="}  # fmt: skip
"""Sequences that arrow keys send, on Windows too."""
END = "x"
ESCAPE = "\x1b"

Keys = Callable[[], str]


def keys_of(console: Console) -> Keys:
    """Return a function that returns the next key, or the next line if input is not a terminal.

    The end of the input stops the study.
    """
    if sys.stdin.isatty():
        return _key
    return lambda: _line(console)


def _key() -> str:
    try:
        pressed = click.getchar()
    except EOFError:  # Ctrl-D
        return END
    return ARROWS.get(pressed, pressed.lower())


@contextmanager
def pressed() -> Iterator[Keys]:
    """Yield a function that returns a key pressed since the last call, or "".

    A file or a pipe is not read, since its lines are answers.
    """
    if not sys.stdin.isatty() or os.name != "posix":
        yield lambda: ""
        return
    import termios
    import tty

    before = termios.tcgetattr(sys.stdin)
    try:
        tty.setcbreak(sys.stdin)
        yield _waiting
    finally:
        termios.tcsetattr(sys.stdin, termios.TCSADRAIN, before)


def _waiting() -> str:
    ready, _, _ = select.select([sys.stdin], [], [], 0.0)
    return os.read(sys.stdin.fileno(), 1).decode("ascii", "ignore").lower() if ready else ""


def _line(console: Console) -> str:
    line = sys.stdin.readline()
    return line.strip().lower() if line else END


def ask_line(console: Console, words: str) -> str:
    """Return a line of text from the person, such as a comment; `END` at the end of the input."""
    if sys.stdin.isatty():
        try:
            return console.input(f"{words}: ", markup=False).strip()
        except EOFError:  # Ctrl-D
            return END
    console.print(f"{words}: ", markup=False, end="")
    line = sys.stdin.readline()
    return line.strip() if line else END
