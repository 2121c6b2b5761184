"""Say what was gained: the best experiment beside the one that it has to beat, KPI by KPI."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from prefcal_env.experiments.experiment import Experiment
from prefcal_env.study import State
from prefcal_scenarios.kpis import WORST
from prefcal_scenarios.presentation.wording import MISSING
from prefcal_scenarios.scenario import KPI

from .compare import Spread, compared, row_of

FIRST, CURRENT = "first experiment", "current tuning"
"""Names of the experiment before: without and with a tuning that the person gave."""

_SLIGHT = 0.05
"""Share of a usual difference in the study below which a change is neither better nor worse."""


@dataclass(frozen=True, slots=True)
class Baseline:
    """The experiment that the result is compared with.

    Args:
        index: Its index, from 0.
        name: "current tuning" if the person gave its values, the name of a reference of the
            scenario if the study started with that, or "first experiment".
    """

    index: int = 0
    name: str = FIRST

    @classmethod
    def of(cls, state: State) -> "Baseline":
        """Return the baseline of a study."""
        start = state.configuration["options"].get("start") or ()
        if not start:
            return cls()
        return cls(0, CURRENT if "=" in start[0] else str(start[0]))

    @property
    def label(self) -> str:
        """Return its name with its number."""
        return self.name if self.name == FIRST else f"{self.name} (experiment {self.index + 1})"


def gained(
    before: Experiment, after: Experiment, kpis: Sequence[KPI], spread: Spread
) -> list[dict[str, Any]]:
    """Return a row for each KPI before and after, largest change first, unmeasured ones last.

    An objective that is met only before or only after comes before all others. Otherwise a change
    is large if it is so in the study and beside the value itself: people know by how many percent
    a KPI changed, and not what is usual.

    The only comparison of the result with what was before: page, terminal, report and acceptance
    sheet show these rows. `change` is empty if a value is missing or infinite, or both meet their
    target alike; `verdict` is "better", "worse", or empty for a slight change and without a goal.

    Args:
        before: Experiment of the baseline.
        after: Best experiment.
        kpis: KPIs to show.
        spread: What is usual in the study.
    """
    rows = [row for row in compared(before, after, kpis, spread) if row["group"] in ("", WORST)]
    rows.sort(key=lambda row: (row["left"]["met"] == row["right"]["met"], -row["change"]))
    found = [_row(row) for row in rows]
    missing = [kpi for kpi in kpis if not {kpi.name} & {*before.kpis, *after.kpis}]
    return found + [_row(row_of(kpi, before, after, 0.0)) for kpi in missing]


def _row(row: dict[str, Any]) -> dict[str, Any]:
    verdict = {"left": "worse", "right": "better", None: ""}[row["better"]]
    before, after = row["left"], row["right"]
    same = "no change" if before["text"] == after["text"] != MISSING else ""
    return {
        **{name: row[name] for name in ("title", "about", "unit", "objective")},
        "before": before["text"],
        "after": after["text"],
        "met": after["met"],
        "change": row["difference"] or same,
        "verdict": verdict if row["size"] >= _SLIGHT else "",
    }
