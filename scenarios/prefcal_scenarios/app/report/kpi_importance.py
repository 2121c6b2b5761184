"""What somebody seems to care about, in words and bars: for the page, terminal and report."""

from collections.abc import Iterator
from dataclasses import dataclass

from prefcal_agents.models.kpi_importance import Importance
from prefcal_agents.models.learned_cost import LearnedCost
from prefcal_scenarios.kpis import titles
from prefcal_scenarios.scenario import Scenario

_SHOWN = 6


@dataclass(frozen=True, slots=True)
class Bar:
    """One line of a chart whose axis runs from 0 to 100 %.

    Args:
        title: Of a KPI.
        share: Of the answers that this KPI alone would have given, 0 to 1; ½ is a coin.
    """

    title: str
    share: float

    @property
    def text(self) -> str:
        """The share as people read it."""
        return f"{100 * self.share:.0f} %"


@dataclass(frozen=True, slots=True)
class Minded:
    """What the answers say of the KPIs, for people.

    Args:
        named: Titles of the KPIs that stand out by evidence; see `Importance`.
        bars: How far single KPIs agree with the answers, the best first.
        explained: Whether a weighted sum of the KPIs predicts answers better than a coin.
        predicted: Answers that it predicted without having learned from them.
        answers: Number of answers that prefer one side.
    """

    named: tuple[str, ...]
    bars: tuple[Bar, ...]
    explained: bool
    predicted: int
    answers: int

    @classmethod
    def of(
        cls, index: LearnedCost | None, importance: Importance | None, scenario: Scenario
    ) -> "Minded | None":
        """In the words of `scenario`; None where the answers say nothing of KPIs."""
        if index is None or importance is None:
            return None
        known = titles(scenario)
        return cls(
            named=tuple(known.get(name, name) for name in importance.named),
            bars=tuple(
                Bar(known.get(name, name), share)
                for name, share in list(importance.agreement.items())[:_SHOWN]
            ),
            explained=index.explains,
            predicted=index.foretold,
            answers=index.answers,
        )

    def sentence(self, who: str = "You seem") -> str:
        """What it comes to."""
        if self.named:
            *most, last = self.named
            listed = " and ".join([", ".join(most), last] if most else [last])
            return f"{who} to care most about: {listed}."
        if self.explained:
            return (
                "Nothing stands out yet: several KPIs count, or the answers do not tell them apart."
            )
        return "Nothing stands out yet: no KPI explains the answers clearly better than chance."

    @property
    def caption(self) -> str:
        """What the bars show."""
        return (
            f"Share of the {self.answers} answers that each KPI alone would have given. "
            "50 % is chance."
        )

    @property
    def trust(self) -> str:
        """How far a weighted sum of the KPIs can be trusted."""
        right = f"{self.predicted} of {self.answers} answers that it had not learned from"
        if self.explained:
            return f"A weighted sum of the KPIs predicted {right}."
        return f"A weighted sum of the KPIs predicted {right}: not clearly better than a coin."

    def drawn(self, width: int) -> Iterator[tuple[str, Bar]]:
        """Each bar in characters on an axis of `width` characters, for a terminal."""
        for bar in self.bars:
            full = round(width * bar.share)
            yield "█" * full + "·" * (width - full), bar
