"""Worth along the studies of a campaign, after so many answers."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from prefcal_bench.cells.result import Result
from prefcal_bench.results.campaign import after_answers
from prefcal_bench.results.paired import Study


@dataclass(frozen=True)
class Courses:
    """Worth along finished studies.

    Args:
        studies: Results by agent, taste and number of experiments.
    """

    studies: dict[tuple[str, str, int], list[Result]] = field(default_factory=dict)

    @classmethod
    def of(cls, results: Iterable[Result]) -> "Courses":
        """Return the courses of the results that have a worth; of repeated ones, the last."""
        latest = {result.cell: result for result in results if result.worth is not None}
        found: dict[tuple[str, str, int], list[Result]] = {}
        for cell, result in latest.items():
            found.setdefault((cell.agent, cell.calibrator, cell.n_max), []).append(result)
        return cls(found)

    def at(self, agent: str, taste: str, answers: int, loops: Sequence[str]) -> dict[Study, float]:
        """Return the worth after so many answers, from the shortest studies that have so many."""
        curves = self.along(agent, taste, answers, loops)
        return {study: float(curve[-1]) for study, curve in curves.items()}

    def questions(
        self, agent: str, taste: str, answers: int, loops: Sequence[str]
    ) -> list[tuple[tuple[int, int, int], ...]]:
        """Return the comparisons of each study, of the shortest studies with so many answers."""
        enough = self._enough(agent, taste, answers)
        chosen = self.studies.get((agent, taste, enough), []) if enough else []
        return [r.comparisons for r in chosen if r.cell.problem in loops and r.comparisons]

    def _enough(self, agent: str, taste: str, answers: int) -> int | None:
        """Return the smallest number of experiments with so many answers; None without any."""
        budgets = [n for who, kind, n in self.studies if (who, kind) == (agent, taste)]
        return min((n for n in budgets if n > answers), default=None)

    def along(
        self, agent: str, taste: str, answers: int, loops: Sequence[str]
    ) -> dict[Study, Float[np.ndarray, " answers+1"]]:
        """Return the worth after 0, 1, ... answers; empty without studies of so many."""
        enough = self._enough(agent, taste, answers)
        if enough is None:
            return {}
        return {
            (r.cell.problem, r.cell.seed): after_answers(np.array(r.worth), np.array(r.questions), answers)
            for r in self.studies[agent, taste, enough]
            if r.cell.problem in loops
        }


def largest_fall(curves: Iterable[Float[np.ndarray, " N"]]) -> float:
    """Return the largest share that the median over the studies loses from its peak so far."""
    median = np.median(np.array(list(curves)), axis=0)
    return float(np.max(1 - median / np.maximum.accumulate(median)))
