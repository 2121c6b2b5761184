"""Read all deviations from the paper; docs/deviations.md shows exactly this table."""

from dataclasses import dataclass
from pathlib import Path

TABLE = Path(__file__).with_name("deviations.md").read_text("utf-8")
"""The table in Markdown: the case studies before the agent."""


@dataclass(frozen=True, slots=True)
class Deviation:
    """A point in which prefcal differs from the paper, or decides where the paper is silent.

    Args:
        paper: What the paper says, with the label of its equation or section.
        ours: What prefcal does.
        why: Reason for the deviation.
        effect: Measured effect, or the reason why there can be none.
    """

    paper: str
    ours: str
    why: str
    effect: str


def _row(line: str) -> Deviation:
    _, *cells, _ = map(str.strip, line.split("|"))
    return Deviation(*cells)


DEVIATIONS = tuple(map(_row, TABLE.splitlines()[2:]))
"""All deviations, a row each."""
