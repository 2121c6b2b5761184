"""Read what the person types: answers from a terminal, a file or a pipe, and θ in words."""

import os
import select
import sys

import numpy as np
from jaxtyping import Float
from rich.console import Console

from prefcal_env.errors import SettingsError
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.wording import did_you_mean
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


def theta_of(text: str, space: KnobSpace, base: tuple[float, ...] | None = None) -> Float[np.ndarray, " n"]:
    """Return the physical θ of `knob=value, ...` in any order, shape (n,).

    Args:
        text: What was typed.
        space: Knobs; a name may be shortened, and has _ for spaces.
        base: Physical θ with the values of knobs that the text leaves out; None if it names all.

    Raises:
        SettingsError: If a knob is unknown, missing or given twice, or a value is not a number.
        KnobError: If a value is outside its knob's range.
    """
    given: dict[str, float] = {}
    for part in text.split(","):
        word, sign, value = (piece.strip() for piece in part.rpartition("="))
        if not sign:
            raise SettingsError(f"expected KNOB=VALUE, got {part.strip()!r} in {text!r}")
        name = knob_called(word, space)
        if name in given:
            raise SettingsError(f"knob {name!r} is given twice in {text!r}")
        try:
            given[name] = float(value)
        except ValueError as error:
            raise SettingsError(f"knob {name!r} must be a number, got {value!r}") from error
    given = {**({} if base is None else dict(zip(space.names, base, strict=True))), **given}
    missing = [name for name in space.names if name not in given]
    if missing:
        raise SettingsError(f"every knob needs a value, {missing} are missing in {text!r}")
    return space.check(np.array([given[name] for name in space.names]))


def knob_called(word: str, space: KnobSpace) -> str:
    """Return the name of the knob that matches `word`, a name or an unambiguous prefix.

    Underscores in `word` match spaces.

    Raises:
        SettingsError: If no knob or more than one knob matches.
    """
    plain = {name.replace(" ", "_"): name for name in space.names}
    wanted = word.replace(" ", "_")
    if wanted in plain:
        return plain[wanted]
    found = [name for key, name in plain.items() if wanted and key.startswith(wanted)]
    if len(found) != 1:
        hint = did_you_mean(word, plain)
        names = ", ".join(plain)
        raise SettingsError(f"knob must be one of {names}, got {word!r}.{hint}".rstrip("."))
    return found[0]
