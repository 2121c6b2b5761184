"""How each agent looks: the same in every figure."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

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
    "LatinHypercube": Look("#4b5563", "^", _DASHED),
    "RandomSearch": Look(FIRST, "v", _DOTTED),
}
"""The project's own agents; dashed or dotted: they do not learn."""
_SPARE = ("#8a4fb0", "#b88a00", "#7a2e04", "#00a3a3", "#e58fb5", "#94b000")
_SPARE_MARKERS = ("<", ">", "p", "*", "h", "d")


def drawn(name: str) -> str:
    """A name as matplotlib draws it as it stands: no formula, and not hidden from a legend."""
    text = printable(name).replace("$", r"\$")
    return f" {text}" if text.startswith("_") else text


def looks(agents: Iterable[str]) -> dict[str, Look]:
    """A look for each agent; one that is not ours gets the next free colour."""
    found: dict[str, Look] = {}
    spare = 0
    for agent in in_order(agents):
        if agent in _KNOWN:
            found[agent] = _KNOWN[agent]
            continue
        turn, i = divmod(spare, len(_SPARE))
        found[agent] = Look(_SPARE[i], _SPARE_MARKERS[i], _DASHED if turn % 2 else "-")
        spare += 1
    return found
