"""The table of the benchmark as data: one row for each problem, calibrator and agent."""

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import groupby
from math import isfinite
from typing import Any

import numpy as np

from prefcal_env.errors import SettingsError
from prefcal_scenarios.bench.problems import HOLES
from prefcal_scenarios.bench.result import Result
from prefcal_scenarios.bench.results.campaign import (
    HUGE,
    Campaign,
    Regime,
    campaign_of,
    curve,
)
from prefcal_scenarios.bench.results.missing import hole_seeds
from prefcal_scenarios.bench.results.statistics import (
    FLOOR,
    Average,
    Difference,
    Quartiles,
    difference,
    holm,
    quartiles,
)

BASELINE = "GLISp"


@dataclass(frozen=True, slots=True)
class Row:
    """An agent on a problem: its final gaps over the seeds, and how they compare.

    Args:
        regime: Calibrator and budget.
        problem: Its name.
        knobs: How many it has, if any result tells.
        agent: Its name.
        seeds: Finished cells.
        failed: Seeds of the failed ones.
        gap: Of what the agent returned; None without a cost or without results.
        visited: Median of the best point visited.
        questions: Median number of questions.
        seconds: Median of a proposal, over the cells where it was measured.
        against: The difference to the baseline; None for itself and without common seeds.
        in_hole: How many seeds ended in the hole of the cost; None where no hole is known.
        p_holm: Its p value after Holm's correction for all agents compared on this problem.
    """

    regime: Regime
    problem: str
    knobs: int | None
    agent: str
    seeds: int
    failed: tuple[int, ...]
    gap: Quartiles | None = None
    visited: float | None = None
    questions: float | None = None
    seconds: float | None = None
    against: Difference | None = None
    in_hole: int | None = None
    p_holm: float | None = None


@dataclass(frozen=True, slots=True)
class Choices:
    """How the table is made: against whom, from which floor, by which average.

    Args:
        baseline: The agent that all are compared with.
        floor: Smaller gaps count as this, above 0.
        average: Of the logarithms of the ratios: "median" or "mean".
        seed: Of the bootstrap's resamples, 0 or more.

    Raises:
        SettingsError: an impossible value.
    """

    baseline: str = BASELINE
    floor: float = FLOOR
    average: Average = "median"
    seed: int = 0

    def __post_init__(self) -> None:
        if not (isfinite(self.floor) and self.floor > 0):
            raise SettingsError(f"floor must be above 0 and finite, got {self.floor!r}")
        if self.average not in ("median", "mean"):
            raise SettingsError(f"average must be 'median' or 'mean', got {self.average!r}")


def rows_of(campaign: Campaign, choices: Choices) -> list[Row]:
    """All rows: by regime, problem and agent. Agents without any cell somewhere have none there."""
    rows = [
        _row(campaign, regime, problem, agent, choices)
        for regime in campaign.regimes
        for problem in campaign.problems(regime)
        for agent in campaign.agents
    ]
    rows = [row for row in rows if row.seeds or row.failed]
    return [
        row
        for _, group in groupby(rows, lambda row: (row.regime, row.problem))
        for row in _corrected(list(group))
    ]


def table(
    results: Iterable[Result],
    *,
    baseline: str = BASELINE,
    floor: float = FLOOR,
    average: Average = "median",
    seed: int = 0,
) -> list[dict[str, Any]]:
    """The table as plain data that JSON can hold; an infinite or unknown number is None.

    Args:
        results: In any order; cells may be missing or failed.
        baseline: The agent that all are compared with; without results of it, no comparison.
        floor: Smaller gaps count as this when they are compared.
        average: Of the logarithms of the paired ratios.
        seed: Of the bootstrap's resamples.

    Raises:
        SettingsError: an impossible option, or results that contradict each other.
    """
    choices = Choices(baseline, floor, average, seed)
    return plain(rows_of(campaign_of(results), choices), choices)


def plain(rows: Sequence[Row], choices: Choices) -> list[dict[str, Any]]:
    """Rows as `table` gives them."""
    return [_plain(row, choices) for row in rows]


def as_csv(rows: Sequence[Mapping[str, Any]]) -> str:
    """Rows of `table` or `duel_table` as CSV with a heading; empty without rows."""
    text = io.StringIO()
    if rows:
        writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    return text.getvalue()


def _row(campaign: Campaign, regime: Regime, problem: str, agent: str, choices: Choices) -> Row:
    runs = campaign.runs(regime, problem, agent)
    row = Row(
        regime, problem, campaign.knobs(problem), agent, len(runs),
        campaign.failures(regime, problem, agent),
    )  # fmt: skip
    if not runs:
        return row
    measured = [r.seconds for r in runs.values() if r.seconds is not None]
    row = replace(
        row,
        questions=float(np.median([r.questions[-1] for r in runs.values()])),
        seconds=float(np.median(measured)) if measured else None,
    )
    if not campaign.has_cost(problem):
        return row
    holed = hole_seeds(campaign, regime, problem, agent)
    seen = [curve(r, returned=False)[-1] for r in runs.values() if r.visited is not None]
    return replace(
        row,
        gap=quartiles([curve(r)[-1] for r in runs.values()]),
        visited=float(np.median(seen)) if seen else None,
        against=_against(campaign, (regime, problem), agent, choices),
        in_hole=None if holed is None else len(holed),
    )


def _against(
    campaign: Campaign, place: tuple[Regime, str], agent: str, choices: Choices
) -> Difference | None:
    ours = campaign.runs(*place, agent)
    theirs = campaign.runs(*place, choices.baseline)
    seeds = [s for s in ours if s in theirs]
    if agent == choices.baseline or not seeds:
        return None
    return difference(
        np.array([curve(ours[s])[-1] for s in seeds]),
        np.array([curve(theirs[s])[-1] for s in seeds]),
        rng=np.random.default_rng(choices.seed),  # the same for each: no row depends on another
        floor=choices.floor,
        average=choices.average,
    )


def _corrected(rows: list[Row]) -> list[Row]:
    """The rows of one problem, with p values corrected for the agents that are tested there."""
    tested = [i for i, row in enumerate(rows) if row.against is not None]
    corrected = holm([d.p for row in rows if (d := row.against) is not None])
    for i, p in zip(tested, corrected, strict=True):
        rows[i] = replace(rows[i], p_holm=p)
    return rows


def _plain(row: Row, choices: Choices) -> dict[str, Any]:
    gap, d = row.gap, row.against
    names = ("pairs", "log10_ratio", "low", "high", "wins", "ties", "losses", "p")
    compared = dict.fromkeys(names) if d is None else asdict(d)
    cells = {
        "problem": row.problem,
        "knobs": row.knobs,
        **asdict(row.regime),
        "agent": row.agent,
        "seeds": row.seeds,
        "failed": len(row.failed),
        "gap_lower_quartile": gap and gap.low,
        "gap_median": gap and gap.median,
        "gap_upper_quartile": gap and gap.high,
        "gap_to_hole_median": _to_hole(row),
        "seeds_in_hole": row.in_hole,
        "visited_median": row.visited,
        "questions_median": row.questions,
        "seconds_per_proposal": row.seconds,
        "baseline": choices.baseline,
        "floor": choices.floor,
        "average": choices.average,
        "pairs": compared["pairs"],
        "log10_ratio": compared["log10_ratio"],
        "log10_ratio_low": compared["low"],
        "log10_ratio_high": compared["high"],
        "wins": compared["wins"],
        "ties": compared["ties"],
        "losses": compared["losses"],
        "p": compared["p"],
        "p_holm": row.p_holm,
    }
    return {key: _known(value) for key, value in cells.items()}


def _to_hole(row: Row) -> float | None:
    """Median gap to the bottom of the hole; None where no hole is known."""
    return row.gap.median + HOLES[row.problem] if row.gap and row.problem in HOLES else None


def _known(value: Any) -> Any:
    """None for what is no number, or stands for infinity."""
    if isinstance(value, float) and not abs(value) < HUGE:
        return None
    return value
