"""How each agent looks: the same in every figure."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

from prefcal_scenarios.bench.results.order import in_order
from prefcal_scenarios.report.style import BEST, FIRST, GOOD, OTHERS
from prefcal_scenarios.report.wording import printable


@dataclass(frozen=True, slots=True)
class Look:
    """Colour, marker and dashes of an agent; the marker tells it without colour too."""

    color: str
    marker: str
    dashes: tuple[int, tuple[int, ...]] | str = "-"


_DOTTED, _DASHED = (0, (1, 1)), (0, (4, 2))
_KNOWN: Mapping[str, Look] = {
    "GLISp": Look(BEST, "o"),
    "GLISp.paper": Look("#56b4e9", "s"),
    "GLIS": Look(OTHERS[0], "D"),
    "PPO": Look(GOOD, "P"),
    "SAC": Look("#c0609a", "X"),
    "ReferenceGLISp": Look("#8a4fb0", "<"),
    "ReferenceGLIS": Look("#7a2e04", "p"),
    "OptunaPreferential": Look("#b88a00", ">"),
    "LatinHypercube": Look("#4b5563", "^", _DASHED),
    "RandomSearch": Look(FIRST, "v", _DOTTED),
}
"""Agents that come with the project; dashed or dotted: they do not learn."""
_SPARE = (Look("#00a3a3", "*"), Look("#e58fb5", "h"), Look("#94b000", "d"))


def drawn(name: str) -> str:
    """A name as matplotlib draws it as it stands: no formula, and not hidden from a legend.

    Of the path of a user's own file, the last part.
    """
    text = printable(name.rpartition("/")[2] or name).replace("$", r"\$")
    return f" {text}" if text.startswith("_") else text


def looks(agents: Iterable[str]) -> dict[str, Look]:
    """A look for each agent; any other than ours gets a free one, of an absent agent if need be."""
    names = in_order(agents)
    absent = [look for name, look in _KNOWN.items() if name not in names and look.dashes == "-"]
    free = [*_SPARE, *absent]
    found: dict[str, Look] = {}
    others = 0
    for name in names:
        if name in _KNOWN:
            found[name] = _KNOWN[name]
            continue
        turn, i = divmod(others, len(free))
        found[name] = replace(free[i], dashes=_DASHED) if turn else free[i]
        others += 1
    return found
