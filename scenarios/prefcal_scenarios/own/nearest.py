"""Suggest the name that was probably meant, for errors about names that do not exist."""

from collections.abc import Iterable
from difflib import get_close_matches

_ALIKE = 0.6  # difflib's own threshold: "Ts" finds "T_s", "nowhere" finds nothing


def did_you_mean(word: str, names: Iterable[str]) -> str:
    """Return " Did you mean 'cstr'?", or nothing if no name resembles `word`.

    Ignores case, spaces, hyphens and underscores.

    Args:
        word: Name that was typed.
        names: Names that exist.
    """
    plain: dict[str, str] = {}
    for name in names:
        plain.setdefault(_plain(name), name)
    typed = _plain(word)
    found = get_close_matches(typed, plain, n=3, cutoff=_ALIKE)
    # Transposed letters come first: "glips" means "glisp", although "glis" is more similar.
    found.sort(key=lambda name: sorted(name) != sorted(typed))
    return f" Did you mean {plain[found[0]]!r}?" if found else ""


def _plain(name: str) -> str:
    return "".join(name.casefold().split()).replace("_", "").replace("-", "")
