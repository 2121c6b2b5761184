"""Read the short texts that describe a knob or a reference, in a file or on the command line."""

import re
from collections.abc import Iterable
from math import isfinite

from prefcal_env.errors import ScenarioError
from prefcal_env.knobs.knob import Knob, Scale
from prefcal_env.optional import WORLDS

KNOB_EXAMPLE = '"K_p=0.1:100:log %/m"'
"""A knob as typed on the command line, for help and messages."""
_RANGE = re.compile(r"([^\s\[]+)\s*(?:\[([^\]]*)\]|(.*))", re.DOTALL)
_COMMA = re.compile(r",(?![^\[]*\])")
"""A comma, but not the one in the name of an array's element, A[1,2]."""


def knob_of(text: str) -> Knob:
    """Return the knob NAME=LOW:HIGH[:log][:int][ UNIT], with or without brackets around the unit.

    Raises:
        ScenarioError: If the text does not read like that.
        KnobError: If the range is not valid.
    """
    name, equals, rest = text.partition("=")
    if not equals or not name.strip():
        raise ScenarioError(
            f"a knob must be NAME=LOW:HIGH[:log][:int] UNIT, for example {KNOB_EXAMPLE}, got {text!r}"
        )
    return ranged_knob(name.strip(), rest)


def ranged_knob(name: str, text: str, about: str = "") -> Knob:
    """Return the knob called `name` with the range LOW:HIGH[:log][:int][ UNIT] in `text`.

    Raises:
        ScenarioError: If the text does not read like that.
        KnobError: If the range is not valid.
    """
    found = _RANGE.fullmatch(text.strip())
    if found is None:
        raise ScenarioError(_wrong(name, text))
    bounds, bracketed, bare = found.groups()
    low, high, *flags = [*bounds.split(":"), ""] if ":" not in bounds else bounds.split(":")
    unknown = [flag for flag in flags if flag not in ("log", "int")]
    if unknown:
        raise ScenarioError(
            f"knob {name!r}: after LOW:HIGH comes :log for a logarithmic scale or :int for whole "
            f"numbers, for example {KNOB_EXAMPLE}, got :{unknown[0]} in {text.strip()!r}"
        )
    scale: Scale = "log10" if "log" in flags else "linear"
    unit = (bracketed if bracketed is not None else bare or "").strip()
    numbers = _number(name, low, text), _number(name, high, text)
    return Knob(name, *numbers, unit, scale=scale, integer="int" in flags, about=about)


def _number(name: str, word: str, text: str) -> float:
    try:
        value = float(word)
    except ValueError:
        raise ScenarioError(_wrong(name, text)) from None
    # Whole numbers stay whole: people read them in tables.
    return int(value) if isfinite(value) and value == int(value) else value


def _wrong(name: str, text: str) -> str:
    return f"knob {name!r}: expected its range LOW:HIGH, for example {KNOB_EXAMPLE}, got {text.strip()!r}"


def listed(texts: Iterable[str]) -> list[str]:
    """Return the names in texts such as "level,valve", in order."""
    names = [name.strip() for text in texts for name in _COMMA.split(text)]
    return [name for name in names if name]


def named_numbers(texts: Iterable[str], flag: str) -> dict[str, float]:
    """Return the numbers by name in texts such as "level=2, flow=0.5".

    Raises:
        ScenarioError: If a text does not read like that; it names `flag` and an example.
    """
    found: dict[str, float] = {}
    for part in listed(texts):
        name, equals, word = (piece.strip() for piece in part.rpartition("="))
        try:
            value = float(word)
        except ValueError:
            value = float("nan")
        if not (equals and name and isfinite(value)):
            others = [f", or, for {w.called}, {flag} {w.unit['reference']}" for w in WORLDS if w.unit]
            raise ScenarioError(
                f"{flag} must be NAME=NUMBER, for example {flag} level=2{''.join(others)}; got {part!r}"
            )
        if name in found:
            raise ScenarioError(f"{flag} gives {name!r} twice: {found[name]:g} and {value:g}")
        found[name] = value
    return found
