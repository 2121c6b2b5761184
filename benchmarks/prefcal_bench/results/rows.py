"""The tables of the benchmark as data: gaps by problem and agent, and worth by taste and agent."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
import pandas as pd

from prefcal_bench.cells.result import Result
from prefcal_bench.problems import HOLES

from .campaign import HUGE, Campaign, campaign_of
from .curves import Curves, Setting, after_answers
from .missing import in_hole
from .statistics import (
    FLOOR,
    difference,
    drift,
    geometric_mean,
    holm,
    improvement,
    interquartile_mean,
)

BASELINE = "GLISp"
FIRST_PART = 0.4
"""Part of the budget after which worth is told for the first time: 20 of 50 experiments."""
SEED = 0
"""Seed of the bootstrap's resamples, the same for each row: rows are independent of each other."""
_GAP_COLUMNS = (
    "setting", "problem", "knobs", "calibrator", "n_init", "n_max", "agent", "seeds", "failed",
    "gap_lower_quartile", "gap_median", "gap_upper_quartile", "gap_to_hole_median",
    "seeds_in_hole", "visited_median", "questions_median", "seconds_per_proposal", "baseline",
    "floor", "average", "pairs", "log10_ratio", "log10_ratio_low", "log10_ratio_high", "wins",
    "ties", "losses", "p", "p_holm", "worth",
)  # fmt: skip


_WORTH_COLUMNS = (
    "setting", "taste", "n_init", "n_max", "agent", "loops", "studies", "unit", "after", "worth",
    "worth_low", "worth_high", "interquartile_mean", "answers", "baseline", "improvement",
    "improvement_low", "improvement_high", "drift",
)  # fmt: skip


def gap_rows(campaign: Campaign, baseline: str = BASELINE) -> pd.DataFrame:
    """Return the table of gaps, sorted by setting, problem and agent, with None where unknown.

    Infinite gaps are `HUGE`. The table has the columns of `table`, and in addition the setting
    and whether the problem is a closed loop whose results are judged by their worth.
    """
    keys = ["setting", "problem", "agent"]
    theirs = campaign.finished[campaign.finished["agent"] == baseline]
    gaps = {
        place: studies.set_index("seed")["gap"]
        for place, studies in theirs.groupby(keys[:2], observed=True)
    }
    worthy = campaign.studies.groupby(keys[:2], observed=True)["worth"].any()
    rows = []
    for (setting, problem, agent), studies in campaign.studies.groupby(keys, observed=True):
        finished = studies[studies["failure"] == ""]
        row = {
            "setting": setting, "problem": problem, "knobs": campaign.knobs(problem),
            **asdict(setting), "agent": agent, "seeds": len(finished),
            "failed": len(studies) - len(finished), "baseline": baseline,
            "floor": FLOOR, "average": "median", "worth": worthy[setting, problem],
            "questions_median": _median(finished["questions"]),
            "seconds_per_proposal": _median(finished["seconds"]),
        }  # fmt: skip
        if len(finished) and finished["cost"].all():
            row |= _gaps(finished, problem)
            if agent != baseline and (setting, problem) in gaps:
                row |= _nearer(finished, gaps[setting, problem])
        rows.append(row)
    table = pd.DataFrame(rows, columns=_GAP_COLUMNS, dtype=object)
    for _, group in table.groupby(keys[:2], sort=False):
        tested = group["p"].dropna()
        table.loc[tested.index, "p_holm"] = holm(list(tested))
    return _without_nan(table)


def table(results: Iterable[Result], *, baseline: str = BASELINE) -> list[dict[str, Any]]:
    """Return the table of gaps as plain data for JSON; infinite or unknown numbers are None.

    Closed loops that are judged by their worth have a table of their own, see `worth_table`.

    Args:
        results: Results in any order; cells may be missing or failed.
        baseline: Agent that all others are compared with, if it has results.

    Raises:
        SettingsError: If results contradict each other.
    """
    return plain_gaps(gap_rows(campaign_of(results), baseline))


def plain_gaps(rows: pd.DataFrame) -> list[dict[str, Any]]:
    """Return rows in the format of `table`, without those that have a worth and so no gap."""
    gaps = rows[~rows["worth"].astype(bool)].drop(columns="worth")
    return [{name: _known(value) for name, value in row.items()} for row in plain(gaps)]


def plain(rows: pd.DataFrame) -> list[dict[str, Any]]:
    """Return rows as plain data, without their setting."""
    records = rows.drop(columns="setting").to_dict("records")
    return [{str(name): value for name, value in row.items()} for row in records]


def as_csv(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return rows of `table` or `duel_table` as CSV with a header; empty without rows."""
    if not rows:
        return ""
    return str(pd.DataFrame(rows, dtype=object).to_csv(index=False, lineterminator="\n"))


def _median(values: pd.Series) -> float | None:
    known = values.dropna()
    return float(np.median(known)) if len(known) else None


def _without_nan(table: pd.DataFrame) -> pd.DataFrame:
    return table.astype(object).where(table.notna(), None)


def _gaps(finished: pd.DataFrame, problem: str) -> dict[str, Any]:
    low, median, high = map(float, np.quantile(finished["gap"], [0.25, 0.5, 0.75]))
    hole = HOLES.get(problem)
    return {
        "gap_lower_quartile": low,
        "gap_median": median,
        "gap_upper_quartile": high,
        "visited_median": _median(finished["visited"]),
        "gap_to_hole_median": None if hole is None else median + hole,
        "seeds_in_hole": None if hole is None else int(in_hole(finished).sum()),
    }


def _nearer(finished: pd.DataFrame, baseline: pd.Series) -> dict[str, Any]:
    """Return how an agent's gaps compare with the baseline's, paired by seed."""
    ours = finished.set_index("seed")["gap"]
    pairs = pd.concat([ours, baseline], axis=1, join="inner", keys=["gap", "baseline"])
    if not len(pairs):
        return {}
    rng = np.random.default_rng(SEED)
    found = difference(pairs["gap"].to_numpy(), pairs["baseline"].to_numpy(), rng=rng)
    names = {"low": "log10_ratio_low", "high": "log10_ratio_high"}
    return {names.get(name, name): value for name, value in asdict(found).items()}


def _known(value: Any) -> Any:
    """Return `value`, or None if it is not a number or stands for infinity."""
    return None if isinstance(value, float) and not abs(value) < HUGE else value


def checkpoints(setting: Setting) -> tuple[int, int]:
    """Return the numbers of experiments after which the tables show the worth."""
    return max(round(FIRST_PART * setting.n_max), 1), setting.n_max


def worth_rows(curves: Curves, baseline: str = BASELINE) -> pd.DataFrame:
    """Return the table of worth, sorted by setting, agent, unit and `after`.

    Its columns are those of `worth_table`, and in addition the setting.

    Args:
        curves: Worth along each study.
        baseline: Agent that all others are compared with, if it has results.
    """
    rows = [row for s in curves.settings for row in _of_setting(curves, s, baseline)]
    return _without_nan(pd.DataFrame(rows, columns=_WORTH_COLUMNS, dtype=object))


def worth_table(curves: Curves, baseline: str = BASELINE) -> list[dict[str, Any]]:
    """Return the table of worth as plain data for JSON and CSV, with None for missing numbers.

    Each row holds an agent's numbers for a taste after so many experiments, or after as many
    answers as one comparison an experiment takes. Columns: loops and studies (numbers), unit
    ("experiments" or "answers") and after, worth (geometric mean, with interval), answers (mean
    number given by then), improvement (probability that the agent's worth exceeds the baseline's,
    with interval), and drift (up to then).
    """
    return plain(worth_rows(curves, baseline))


def _of_setting(curves: Curves, setting: Setting, baseline: str) -> list[dict[str, Any]]:
    studies = curves.of(setting)
    groups = dict(iter(studies.groupby("agent", observed=True)))
    spots = [("experiments", n) for n in checkpoints(setting)]
    spots += [("answers", n - 1) for n in checkpoints(setting) if n > 1]
    rows = []
    for agent, group in groups.items():
        asked = np.array([a[-1] for a in group["asked"]])
        for unit, after in spots:
            if unit == "answers" and not asked.any():
                continue
            held = _held(group, unit, after)
            row: dict[str, Any] = {
                "setting": setting, "taste": setting.calibrator, "n_init": setting.n_init,
                "n_max": setting.n_max, "agent": agent, "studies": len(group), "unit": unit,
                "after": after, "answers": _answers(group, unit, after),
                "drift": drift(held), **_worth(held), "baseline": baseline,
            }  # fmt: skip
            if baseline in groups and agent != baseline:
                row |= _against(held, _held(groups[baseline], unit, after))
            rows.append(row)
    return rows


def _held(studies: pd.DataFrame, unit: str, after: int) -> pd.Series:
    """Return the worth along each study up to a number of experiments or answers, by loop."""
    pairs = zip(studies["worth"], studies["asked"], strict=True)
    cut = [
        worth[:after] if unit == "experiments" else after_answers(worth, asked, after)
        for worth, asked in pairs
    ]
    return pd.Series(cut, index=studies["loop"].astype(str), dtype=object)


def _answers(studies: pd.DataFrame, unit: str, after: int) -> float:
    """Return the mean number of answers given by then."""
    if unit == "experiments":
        return float(np.mean([asked[after - 1] for asked in studies["asked"]]))
    return float(np.mean([min(asked[-1], after) for asked in studies["asked"]]))


def _by_loop(held: pd.Series) -> Mapping[str, Any]:
    ends = held.map(lambda curve: curve[-1]).astype(float)
    return {loop: group.to_numpy() for loop, group in ends.groupby(level=0, sort=False)}


def _worth(held: pd.Series) -> dict[str, Any]:
    loops = list(_by_loop(held).values())
    found = geometric_mean(loops, rng=np.random.default_rng(SEED))
    return {
        "loops": len(loops), "worth": found.value, "worth_low": found.low,
        "worth_high": found.high, "interquartile_mean": interquartile_mean(loops),
    }  # fmt: skip


def _against(held: pd.Series, others: pd.Series) -> dict[str, Any]:
    ours, theirs = _by_loop(held), _by_loop(others)
    common = [loop for loop in ours if loop in theirs]
    if not common:
        return {}
    found = improvement(
        [ours[loop] for loop in common], [theirs[loop] for loop in common],
        rng=np.random.default_rng(SEED),
    )  # fmt: skip
    return {
        "improvement": found.value, "improvement_low": found.low, "improvement_high": found.high,
    }  # fmt: skip
