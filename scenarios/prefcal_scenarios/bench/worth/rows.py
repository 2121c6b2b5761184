"""The table of worth, with a row for each taste, agent, and number of experiments or answers."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from .curves import Curves, Setting, after_answers
from .statistics import drift, geometric_mean, improvement, interquartile_mean

FIRST_PART = 0.4
"""Part of the budget after which the tables look for the first time: 20 of 50 experiments."""
_COLUMNS = (
    "setting", "taste", "n_init", "n_max", "agent", "loops", "studies", "unit", "after", "worth",
    "worth_low", "worth_high", "interquartile_mean", "answers", "baseline", "improvement",
    "improvement_low", "improvement_high", "drift",
)  # fmt: skip


def checkpoints(setting: Setting) -> tuple[int, int]:
    """Return the numbers of experiments after which the tables show the worth."""
    return max(round(FIRST_PART * setting.n_max), 1), setting.n_max


def worth_rows(curves: Curves, baseline: str, seed: int = 0) -> pd.DataFrame:
    """Return the table of worth, sorted by setting, agent, unit and `after`.

    Its columns are those of `worth_table`, and in addition the setting.

    Args:
        curves: Worth along each study.
        baseline: Agent that all others are compared with, if it has results.
        seed: Seed of the bootstrap's resamples.
    """
    rows = [row for s in curves.settings for row in _of_setting(curves, s, baseline, seed)]
    table = pd.DataFrame(rows, columns=_COLUMNS, dtype=object)
    return table.astype(object).where(table.notna(), None)


def plain_worth(rows: pd.DataFrame) -> list[dict[str, Any]]:
    """Return rows in the format of `worth_table`."""
    return [
        {str(name): value for name, value in row.items()}
        for row in rows.drop(columns="setting").to_dict("records")
    ]


def worth_table(curves: Curves, baseline: str, seed: int = 0) -> list[dict[str, Any]]:
    """Return the table of worth as plain data for JSON and CSV, with None for missing numbers.

    Each row holds an agent's numbers for a taste after so many experiments, or after as many
    answers as one comparison an experiment takes. Columns: loops and studies (numbers), unit
    ("experiments" or "answers") and after, worth (geometric mean, with interval), answers (mean
    number given by then), improvement (probability that the agent's worth exceeds the baseline's,
    with interval), and drift (up to then).
    """
    return plain_worth(worth_rows(curves, baseline, seed))


def _of_setting(curves: Curves, setting: Setting, baseline: str, seed: int) -> list[dict[str, Any]]:
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
                "setting": setting, "taste": setting.taste, "n_init": setting.n_init,
                "n_max": setting.n_max, "agent": agent, "studies": len(group), "unit": unit,
                "after": after, "answers": _answers(group, unit, after),
                "drift": drift(held), **_worth(held, seed), "baseline": baseline,
            }  # fmt: skip
            if baseline in groups and agent != baseline:
                row |= _against(held, _held(groups[baseline], unit, after), seed)
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


def _worth(held: pd.Series, seed: int) -> dict[str, Any]:
    loops = list(_by_loop(held).values())
    # The same generator for each row: rows are independent of each other.
    found = geometric_mean(loops, rng=np.random.default_rng(seed))
    return {
        "loops": len(loops), "worth": found.value, "worth_low": found.low,
        "worth_high": found.high, "interquartile_mean": interquartile_mean(loops),
    }  # fmt: skip


def _against(held: pd.Series, others: pd.Series, seed: int) -> dict[str, Any]:
    ours, theirs = _by_loop(held), _by_loop(others)
    common = [loop for loop in ours if loop in theirs]
    if not common:
        return {}
    found = improvement(
        [ours[loop] for loop in common], [theirs[loop] for loop in common],
        rng=np.random.default_rng(seed),
    )  # fmt: skip
    return {
        "improvement": found.value, "improvement_low": found.low, "improvement_high": found.high,
    }  # fmt: skip
