"""What somebody seems to care about, in words and shares: for the page, terminal and report."""

from collections.abc import Iterator
from dataclasses import dataclass

from prefcal_agents.learned_index import LearnedIndex
from prefcal_scenarios.outcomes import titles
from prefcal_scenarios.scenario import Scenario

_NAMED = 3
"""KPIs that the sentence names at most."""
_COUNTS = 0.5
"""Share of the heaviest from which on another one is named beside it."""
_SHOWN = 6


@dataclass(frozen=True, slots=True)
class Bar:
    """One line of a chart.

    Args:
        title: Of a KPI, or of all small ones together.
        share: Of all weights, above 0.
        width: Relative to the heaviest KPI, at most 1.
        rest: Whether it is the sum of the small ones.
    """

    title: str
    share: float
    width: float
    rest: bool = False

    @property
    def text(self) -> str:
        """The share as people read it."""
        return f"{100 * self.share:.0f} %"


@dataclass(frozen=True, slots=True)
class Minded:
    """The weights of a learned index for people.

    Args:
        named: Titles of the KPIs that weigh most, the heaviest first.
        bars: The heaviest first; empty where the KPIs do not explain the answers.
        foretold: Answers that were foretold without having been learned from.
        answers: Of so many.
    """

    named: tuple[str, ...]
    bars: tuple[Bar, ...]
    foretold: int
    answers: int

    @classmethod
    def of(cls, index: LearnedIndex | None, scenario: Scenario) -> "Minded | None":
        """In the words of `scenario`; None where there is no index."""
        if index is None:
            return None
        if not index.explains:
            return cls((), (), index.foretold, index.answers)
        known = titles(scenario)
        terms = [(known.get(name, name), share) for name, share in index.weights.items()]
        named = [title for title, share in terms if share >= _COUNTS * terms[0][1]][:_NAMED]
        return cls(tuple(named), tuple(_bars(terms)), index.foretold, index.answers)

    def sentence(self, who: str = "You seem") -> str:
        """What it comes to."""
        if not self.named:
            return "The indicators do not explain the answers (yet)."
        *most, last = self.named
        listed = " and ".join([", ".join(most), last] if most else [last])
        return f"{who} to care most about: {listed}."

    @property
    def trust(self) -> str:
        """How far to trust it."""
        right = f"{self.foretold} of {self.answers} answers that it had not learned from"
        if self.named:
            return f"A weighted sum of the indicators foretold {right}."
        return f"A weighted sum of them foretold only {right}: hardly better than a coin."


def _bars(terms: list[tuple[str, float]]) -> Iterator[Bar]:
    shown = len(terms) if len(terms) <= _SHOWN + 1 else _SHOWN
    widest = terms[0][1]
    for title, share in terms[:shown]:
        yield Bar(title, share, share / widest)
    rest = sum(share for _, share in terms[shown:])
    if rest:
        title = f"{len(terms) - shown} others together"
        yield Bar(title, rest, min(rest / widest, 1.0), rest=True)
