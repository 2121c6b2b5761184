"""Phrase messages for people: the name that was probably meant, its unit, and how many more there are."""

from collections.abc import Iterable
from difflib import get_close_matches
from pathlib import Path

_ALIKE = 0.6  # difflib's own threshold: "Ts" finds "T_s", "nowhere" finds nothing


def did_you_mean(word: str, names: Iterable[str]) -> str:
    """Return " Did you mean 'cstr'?", or nothing if no name resembles `word`.

    Ignores case, spaces, hyphens and underscores, and finds "K_p" as the last part of
    "controller.K_p".

    Args:
        word: Name that was typed.
        names: Names that exist.
    """
    whole: dict[str, str] = {}
    last: dict[str, str] = {}
    for name in names:
        whole.setdefault(_plain(name), name)
        last.setdefault(_plain(name.rpartition(".")[2]), name)
    typed = _plain(word)
    for plain in (whole, last):
        found = get_close_matches(typed, plain, n=3, cutoff=_ALIKE)
        # Transposed letters come first: "glips" means "glisp", although "glis" is more similar.
        found.sort(key=lambda name: sorted(name) != sorted(typed))
        if found:
            return f" Did you mean {plain[found[0]]!r}?"
    return ""


def and_more(count: int) -> str:
    """Return " (and 2 more)" if a message names the first of 3; nothing if there is only one."""
    return f" (and {count - 1} more)" if count > 1 else ""


def labeled(name: str, unit: str) -> str:
    """Return a name with its unit, for headings and axes in plain text."""
    return f"{name} [{unit}]" if unit else name


def place_in_code(function: object) -> str:
    """Return where a function is defined, such as " (own.py:12)"; "" if Python cannot tell."""
    code = getattr(function, "__code__", None)
    return "" if code is None else f" ({Path(code.co_filename).name}:{code.co_firstlineno})"


def brief(value: object) -> str:
    """Return the type and the beginning of a value, for messages."""
    return "None" if value is None else f"{type(value).__name__} {value!r:.60}"


def _plain(name: str) -> str:
    return "".join(name.casefold().split()).replace("_", "").replace("-", "")
