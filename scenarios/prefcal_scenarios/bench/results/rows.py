"""The table of the benchmark, with a row for each problem, calibrator and agent."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from math import isfinite
from typing import Any

import numpy as np
import pandas as pd

from prefcal_env.errors import SettingsError
from prefcal_scenarios.bench.problems import HOLES
from prefcal_scenarios.bench.result import Result

from .campaign import HUGE, Campaign, campaign_of
from .missing import in_hole
from .statistics import FLOOR, Average, difference, holm, quartiles

BASELINE = "GLISp"
_COLUMNS = (
    "regime", "problem", "knobs", "calibrator", "n_init", "n_max", "agent", "seeds", "failed",
    "gap_lower_quartile", "gap_median", "gap_upper_quartile", "gap_to_hole_median",
    "seeds_in_hole", "visited_median", "questions_median", "seconds_per_proposal", "baseline",
    "floor", "average", "pairs", "log10_ratio", "log10_ratio_low", "log10_ratio_high", "wins",
    "ties", "losses", "p", "p_holm", "worth",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Choices:
    """Options of the table.

    Args:
        baseline: Agent that all others are compared with.
        floor: Value that replaces smaller gaps, above 0.
        average: Average of the logarithms of the ratios: "median" or "mean".
        seed: Seed of the bootstrap's resamples, 0 or more.

    Raises:
        SettingsError: If a value is invalid.
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


def rows_of(campaign: Campaign, choices: Choices) -> pd.DataFrame:
    """Return the table, sorted by regime, problem and agent, with None for missing numbers.

    Infinite gaps are `HUGE`. The table has the columns of `plain`, and in addition the regime
    and whether the problem is a closed loop whose results are judged by their worth.
    """
    keys = ["regime", "problem", "agent"]
    baseline = campaign.finished[campaign.finished["agent"] == choices.baseline]
    gaps = {
        place: studies.set_index("seed")["gap"]
        for place, studies in baseline.groupby(["regime", "problem"], observed=True)
    }
    worthy = campaign.studies.groupby(["regime", "problem"], observed=True)["worth"].any()
    rows = []
    for (regime, problem, agent), studies in campaign.studies.groupby(keys, observed=True):
        finished = studies[studies["failure"] == ""]
        row = {
            "regime": regime, "problem": problem, "knobs": campaign.knobs(problem),
            **asdict(regime), "agent": agent, "seeds": len(finished),
            "failed": len(studies) - len(finished), "baseline": choices.baseline,
            "floor": choices.floor, "average": choices.average, "worth": worthy[regime, problem],
            "questions_median": _median(finished["questions"]),
            "seconds_per_proposal": _median(finished["seconds"]),
        }  # fmt: skip
        if len(finished) and finished["cost"].all():
            row |= _gaps(finished, problem)
            if agent != choices.baseline and (regime, problem) in gaps:
                row |= _against(finished, gaps[regime, problem], choices)
        rows.append(row)
    table = pd.DataFrame(rows, columns=_COLUMNS, dtype=object)
    for _, group in table.groupby(["regime", "problem"], sort=False):
        tested = group["p"].dropna()
        table.loc[tested.index, "p_holm"] = holm(list(tested))
    return table.astype(object).where(table.notna(), None)


def table(
    results: Iterable[Result],
    *,
    baseline: str = BASELINE,
    floor: float = FLOOR,
    average: Average = "median",
    seed: int = 0,
) -> list[dict[str, Any]]:
    """Return the table of gaps as plain data for JSON; infinite or unknown numbers are None.

    Closed loops that are judged by their worth have a table of their own, see `worth_table`.

    Args:
        results: Results in any order; cells may be missing or failed.
        baseline: Agent that all others are compared with, if it has results.
        floor: Value that replaces smaller gaps in comparisons.
        average: Average of the logarithms of the paired ratios.
        seed: Seed of the bootstrap's resamples.

    Raises:
        SettingsError: If an option is invalid, or results contradict each other.
    """
    choices = Choices(baseline, floor, average, seed)
    return plain(rows_of(campaign_of(results), choices))


def plain(rows: pd.DataFrame) -> list[dict[str, Any]]:
    """Return rows in the format of `table`, without those that have a worth and so no gap."""
    return [
        {name: _known(value) for name, value in row.items()}
        for row in rows[~rows["worth"].astype(bool)]
        .drop(columns=["regime", "worth"])
        .to_dict("records")
    ]


def as_csv(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return rows of `table` or `duel_table` as CSV with a header; empty without rows."""
    if not rows:
        return ""
    return str(pd.DataFrame(rows, dtype=object).to_csv(index=False, lineterminator="\n"))


def _median(values: pd.Series) -> float | None:
    known = values.dropna()
    return float(np.median(known)) if len(known) else None


def _gaps(finished: pd.DataFrame, problem: str) -> dict[str, Any]:
    gap = quartiles(finished["gap"].to_numpy())
    hole = HOLES.get(problem)
    return {
        "gap_lower_quartile": gap.low,
        "gap_median": gap.median,
        "gap_upper_quartile": gap.high,
        "visited_median": _median(finished["visited"]),
        "gap_to_hole_median": None if hole is None else gap.median + hole,
        "seeds_in_hole": None if hole is None else int(in_hole(finished).sum()),
    }


def _against(finished: pd.DataFrame, baseline: pd.Series, choices: Choices) -> dict[str, Any]:
    """Return how an agent's gaps compare with the baseline's, paired by seed."""
    ours = finished.set_index("seed")["gap"]
    pairs = pd.concat([ours, baseline], axis=1, join="inner", keys=["gap", "baseline"])
    if not len(pairs):
        return {}
    found = difference(
        pairs["gap"].to_numpy(),
        pairs["baseline"].to_numpy(),
        rng=np.random.default_rng(choices.seed),  # the same for each row: rows are independent
        floor=choices.floor,
        average=choices.average,
    )
    names = {"low": "log10_ratio_low", "high": "log10_ratio_high"}
    return {names.get(name, name): value for name, value in asdict(found).items()}


def _known(value: Any) -> Any:
    """Return `value`, or None if it is not a number or stands for infinity."""
    return None if isinstance(value, float) and not abs(value) < HUGE else value
