"""Read what the person types: a line for each answer, from a terminal, a file or a pipe."""

import os
import select
import sys

from rich.console import Console

from prefcal_scenarios.presentation.wording import printable

END = "x"


def ask_line(console: Console, words: str) -> str:
    """Return a line of text from the person; `END` at the end of the input.

    A line from a file or a pipe is printed, as a terminal shows what is typed.
    """
    if sys.stdin.isatty():
        try:
            return console.input(f"{words}: ", markup=False).strip()
        except EOFError:  # Ctrl-D
            return END
    console.print(f"{words}: ", markup=False, end="")
    line = sys.stdin.readline()
    said = line.strip() if line else END
    console.print(printable(said), markup=False, highlight=False, soft_wrap=True)
    return said


def typed() -> str | None:
    """Return the line that was typed at a terminal since the last call; None if there is none.

    A file or a pipe is not read, since its lines are answers.
    """
    if not sys.stdin.isatty() or os.name != "posix":
        return None
    ready, _, _ = select.select([sys.stdin], [], [], 0.0)
    return sys.stdin.readline().strip().lower() if ready else None
