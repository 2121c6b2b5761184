"""Describe which KPIs seem to matter to a person, for the page, the terminal and the report."""

from collections.abc import Iterator
from dataclasses import dataclass

from prefcal_agents.models.kpi_importance import FEWEST, Importance
from prefcal_agents.models.learned_cost import LearnedCost
from prefcal_scenarios.kpis import titles
from prefcal_scenarios.scenario import Scenario

_SHOWN = 6


@dataclass(frozen=True, slots=True)
class Bar:
    """A bar of a chart whose axis runs from 0 to 100 %.

    Args:
        title: Title of a KPI.
        share: Share of the answers that this KPI alone would have given, 0 to 1; ½ is chance.
    """

    title: str
    share: float

    @property
    def text(self) -> str:
        """Return the share as a percentage."""
        return f"{100 * self.share:.0f} %"


@dataclass(frozen=True, slots=True)
class KpiImportance:
    """Description of what the answers say about the KPIs.

    Args:
        named: Titles of the KPIs that clearly stand out; see `Importance`.
        bars: Agreement of single KPIs with the answers, the best first; none while there are few.
        explained: Whether a weighted sum of the KPIs predicts answers better than chance.
        predicted: Number of answers that it predicted without having learned from them.
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
    ) -> "KpiImportance | None":
        """Return the description with the scenario's titles; None if the answers say nothing."""
        if index is None or importance is None:
            return None
        known = titles(scenario)
        return cls(
            named=tuple(known.get(name, name) for name in importance.named),
            bars=tuple(
                Bar(known.get(name, name), share)
                for name, share in list(importance.agreement.items())[:_SHOWN]
            )
            if importance.answers >= FEWEST
            else (),
            explained=index.explains,
            predicted=index.predicted,
            answers=index.answers,
        )

    def sentence(self, who: str = "You seem") -> str:
        """Return the main finding as a sentence."""
        if self.named:
            *most, last = self.named
            listed = " and ".join([", ".join(most), last] if most else [last])
            return f"{who} to care most about: {listed}."
        if not self.bars:
            so_far = f"so far there {'is' if self.answers == 1 else 'are'} {self.answers}"
            return f"This takes {FEWEST} answers that prefer one side: {so_far}."
        best = self.bars[0]
        given = f"{best.title} alone would have given {best.text} of the answers, the most of all"
        return f"Nothing stands out yet: {given}."

    @property
    def caption(self) -> str:
        """Return the caption of the bars; empty if there are none."""
        if not self.bars:
            return ""
        return (
            f"Share of the {self.answers} answers that each KPI alone would have given. "
            "50 % is chance."
        )

    @property
    def trust(self) -> str:
        """Return how reliable a weighted sum of the KPIs is."""
        right = f"{self.predicted} of {self.answers} answers that it had not learned from"
        if self.explained:
            return f"A weighted sum of the KPIs predicted {right}."
        return f"A weighted sum of the KPIs predicted {right}: not clearly better than chance."

    def drawn(self, width: int) -> Iterator[tuple[str, Bar]]:
        """Yield each bar as text of at most `width` characters, for a terminal."""
        for bar in self.bars:
            full = round(width * bar.share)
            yield "█" * full + "·" * (width - full), bar
