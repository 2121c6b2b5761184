"""The name that was probably meant, for errors about names that do not exist."""

from collections.abc import Iterable
from difflib import get_close_matches

_ALIKE = 0.6  # difflib's own threshold: "Ts" finds "T_s", "nowhere" finds nothing


def did_you_mean(word: str, names: Iterable[str]) -> str:
    """Return " Did you mean 'cstr'?", or nothing if no name resembles `word`.

    Case, spaces, hyphens and underscores do not count.

    Args:
        word: What was typed.
        names: The names that exist.
    """
    plain: dict[str, str] = {}
    for name in names:
        plain.setdefault(_plain(name), name)
    typed = _plain(word)
    found = get_close_matches(typed, plain, n=3, cutoff=_ALIKE)
    # Letters that changed places come first: "glips" is "glisp", though "glis" shares more.
    found.sort(key=lambda name: sorted(name) != sorted(typed))
    return f" Did you mean {plain[found[0]]!r}?" if found else ""


def _plain(name: str) -> str:
    return "".join(name.casefold().split()).replace("_", "").replace("-", "")
