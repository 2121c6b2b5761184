"""The tables of the benchmark as data: gaps by problem, worth by taste, and duels by pair of agents."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, fields
from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import binomtest

from prefcal_bench.cells.cell import Result
from prefcal_bench.cells.duels import PAPER, Duel
from prefcal_bench.cells.roster import in_order
from prefcal_env.errors import SettingsError

from .campaign import HUGE, Campaign, Setting, after_answers, campaign_of
from .statistics import (
    CONFIDENCE,
    FLOOR,
    Difference,
    MeanEstimate,
    difference,
    drift,
    geometric_mean,
    holm,
    improvement,
    interquartile_mean,
)

BASELINE = "GLISp"
FIRST_PART = 0.4  # part of the budget after which worth is told for the first time: 20 of 50 experiments
SEED = 0  # seed of the bootstrap's resamples, the same for each row: rows are independent of each other
_QUARTILES = ("gap_lower_quartile", "gap_median", "gap_upper_quartile")
_DIFFERENCE = tuple(field.name for field in fields(Difference))
_PAIR = ["problem", "calibrator", "agent", "rival"]


def gap_rows(campaign: Campaign, baseline: str = BASELINE) -> pd.DataFrame:
    """Return the table of gaps, sorted by setting, problem and agent, with None where unknown.

    Infinite gaps are `HUGE`. The table has the columns of `table`, and in addition the setting.
    Where results are judged by their worth there are no rows: see `worth_rows`.
    """
    rows: list[dict[str, Any]] = []
    for (setting, problem), there in campaign.ours.groupby(["setting", "problem"], observed=True):
        if there["worth"].notna().any():
            continue
        agents = dict(iter(there.groupby("agent", observed=True)))
        gaps = {agent: _last_gaps(group) for agent, group in agents.items()}
        about = {"setting": setting, "problem": problem, "knobs": campaign.knobs(problem), **asdict(setting)}
        here: list[dict[str, Any]] = []
        for agent, group in agents.items():
            found = _nearer(gaps[agent], gaps[baseline]) if agent != baseline and baseline in gaps else None
            compared: dict[str, Any] = dict.fromkeys(_DIFFERENCE) if found is None else asdict(found)
            statistics = {"baseline": baseline, "floor": FLOOR, "average": "median"}
            row = about | {"agent": agent} | _gap_row(group, gaps[agent]) | statistics | compared
            here.append(row | {"p_holm": None})
        tested = [row for row in here if row["p"] is not None]
        for row, p in zip(tested, holm([row["p"] for row in tested]), strict=True):
            row["p_holm"] = p
        rows += here
    return _table(rows, ["setting", "problem", "gap_median", "failed"])


def table(results: Iterable[Result], *, baseline: str = BASELINE) -> list[dict[str, Any]]:
    """Return the table of gaps as plain data for JSON; infinite or unknown numbers are None.

    Closed loops that are judged by their worth have a table of their own, see `worth_table`.

    Args:
        results: Results in any order; cells may be missing or failed.
        baseline: Agent that all others are compared with, if it has results.

    Raises:
        SettingsError: If results contradict each other.
    """
    return plain(gap_rows(campaign_of(results), baseline))


def plain(rows: pd.DataFrame) -> list[dict[str, Any]]:
    """Return rows as plain data without their setting; infinite numbers are None."""
    records = rows.drop(columns="setting").to_dict("records")
    return [{str(name): _known(value) for name, value in row.items()} for row in records]


def as_csv(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return rows of `table` or `duel_table` as CSV with a header; empty without rows."""
    if not rows:
        return ""
    return str(pd.DataFrame(rows, dtype=object).to_csv(index=False, lineterminator="\n"))


def _known(value: Any) -> Any:
    """Return `value`, or None if it is not a number or stands for infinity."""
    return None if isinstance(value, float) and not abs(value) < HUGE else value


def _table(rows: list[dict[str, Any]], least: Sequence[str]) -> pd.DataFrame:
    """Return rows, all with the same columns, as a table; without any row it has those of `least`."""
    found = pd.DataFrame(rows, columns=list(rows[0] if rows else least), dtype=object)
    return found.where(found.notna(), None)


def _median(values: Iterable[float]) -> float | None:
    known = pd.Series(list(values), dtype=float).dropna()
    return float(known.median()) if len(known) else None


def _last_gaps(studies: pd.DataFrame) -> pd.Series:
    """Return the gaps at the end by seed, of the studies that have one."""
    curves = studies.dropna(subset="gap").set_index("seed")["gap"]
    return curves.map(lambda curve: curve[-1]).astype(float)


def _gap_row(studies: pd.DataFrame, gaps: pd.Series) -> dict[str, Any]:
    finished = studies[studies["failure"] == ""]
    quartiles = map(float, np.quantile(gaps, [0.25, 0.5, 0.75])) if len(gaps) else [None] * 3
    return {
        "seeds": len(finished),
        "failed": len(studies) - len(finished),
        **dict(zip(_QUARTILES, quartiles, strict=True)),
        "visited_median": _median(finished["visited"]) if len(gaps) else None,
        "questions_median": _median(asked[-1] for asked in finished["asked"]),
        "seconds_per_proposal": _median(finished["seconds"]),
    }


def _nearer(gaps: pd.Series, baseline: pd.Series) -> Difference | None:
    """Return how an agent's gaps compare with the baseline's, paired by seed; None without pairs."""
    seeds = gaps.index.intersection(baseline.index)
    if not len(seeds):
        return None
    rng = np.random.default_rng(SEED)
    return difference(gaps[seeds].to_numpy(), baseline[seeds].to_numpy(), rng=rng)


def checkpoints(setting: Setting) -> tuple[int, int]:
    """Return the numbers of experiments after which the tables show the worth."""
    return max(round(FIRST_PART * setting.n_max), 1), setting.n_max


def worth_rows(campaign: Campaign, baseline: str = BASELINE) -> pd.DataFrame:
    """Return the table of worth, sorted by setting, agent, unit and `after`.

    Its columns are those of `worth_table`, and in addition the setting.
    """
    rows = [row for s in campaign.having("worth") for row in _of_setting(campaign, s, baseline)]
    return _table(rows, ["setting"])


def worth_table(campaign: Campaign, baseline: str = BASELINE) -> list[dict[str, Any]]:
    """Return the table of worth as plain data for JSON and CSV, with None for missing numbers.

    Each row holds an agent's numbers for a taste after so many experiments, or after as many
    answers as one comparison an experiment takes. Columns: loops and studies (numbers), unit
    ("experiments" or "answers") and after, worth (geometric mean, with interval), answers (mean
    number given by then), improvement (probability that the agent's worth exceeds the baseline's,
    with interval), and drift (up to then).

    Args:
        campaign: All results.
        baseline: Agent that the others are compared with.
    """
    return plain(worth_rows(campaign, baseline))


def ended(rows: pd.DataFrame, setting: Setting) -> pd.DataFrame:
    """Return the rows of worth of a setting after all its experiments, the highest worth first."""
    last = (rows["unit"] == "experiments") & (rows["after"] == setting.n_max)
    found = rows[(rows["setting"] == setting) & last]
    return found.sort_values("worth", ascending=False, kind="stable")


def _of_setting(campaign: Campaign, setting: Setting, baseline: str) -> list[dict[str, Any]]:
    groups = dict(iter(campaign.of(setting, "worth").groupby("agent", observed=True)))
    spots = [("experiments", n) for n in checkpoints(setting)]
    spots += [("answers", n - 1) for n in checkpoints(setting) if n > 1]
    rows = []
    for agent, group in groups.items():
        for unit, after in spots:
            if unit == "answers" and not any(asked[-1] for asked in group["asked"]):
                continue
            held, others = _held(group, unit, after), None
            if baseline in groups and agent != baseline:
                others = _held(groups[baseline], unit, after)
            loops = _by_loop(held)
            rows.append(
                {
                    "setting": setting,
                    "taste": setting.calibrator,
                    "n_init": setting.n_init,
                    "n_max": setting.n_max,
                    "agent": agent,
                    "loops": len(loops),
                    "studies": len(group),
                    "unit": unit,
                    "after": after,
                    **_columns("worth", geometric_mean([*loops.values()], rng=np.random.default_rng(SEED))),
                    "interquartile_mean": interquartile_mean([*loops.values()]),
                    "answers": _answers(group, unit, after),
                    "baseline": baseline,
                    **_columns("improvement", None if others is None else _against(loops, _by_loop(others))),
                    "drift": drift(held),
                }
            )
    return rows


def _held(studies: pd.DataFrame, unit: str, after: int) -> pd.Series:
    """Return the worth along each study up to a number of experiments or answers, by loop."""
    pairs = zip(studies["worth"], studies["asked"], strict=True)
    cut = [
        worth[:after] if unit == "experiments" else after_answers(worth, asked, after)
        for worth, asked in pairs
    ]
    return pd.Series(cut, index=studies["problem"].astype(str), dtype=object)


def _answers(studies: pd.DataFrame, unit: str, after: int) -> float:
    """Return the mean number of answers given by then."""
    if unit == "experiments":
        return float(np.mean([asked[after - 1] for asked in studies["asked"]]))
    return float(np.mean([min(asked[-1], after) for asked in studies["asked"]]))


def _by_loop(held: pd.Series) -> Mapping[str, Any]:
    ends = held.map(lambda curve: curve[-1]).astype(float)
    return {loop: group.to_numpy() for loop, group in ends.groupby(level=0, sort=False)}


def _against(ours: Mapping[str, Any], theirs: Mapping[str, Any]) -> MeanEstimate | None:
    """Return the probability of being better on the loops that both have; None without any."""
    common = [loop for loop in ours if loop in theirs]
    pairs = [ours[loop] for loop in common], [theirs[loop] for loop in common]
    return improvement(*pairs, rng=np.random.default_rng(SEED)) if common else None


def _columns(name: str, found: MeanEstimate | None) -> dict[str, Any]:
    values = (None, None, None) if found is None else (found.value, found.low, found.high)
    return dict(zip((name, f"{name}_low", f"{name}_high"), values, strict=True))


def duel_rows(duels: Iterable[Duel]) -> pd.DataFrame:
    """Return the counts of all duels, each from both sides; duplicates count once.

    A row is an agent and its rival, another agent or `PAPER`, on one problem without a cost, with
    the calibrator that answered in the studies. Columns: these four, seeds (number of duels), wins,
    ties and losses of the agent, share (wins / seeds), low and high (its exact, Clopper-Pearson,
    95 % interval), and p (exact two-sided sign test on wins and losses; 1 if all are ties).

    Raises:
        SettingsError: If an agent meets itself, or one duel has two outcomes.
    """
    sides = []
    for d in duels:
        if d.agent in (d.rival, PAPER):
            raise SettingsError(f"a duel must be between an agent and a different rival, got {d}")
        sides.append((d.problem, d.calibrator, d.agent, d.rival, d.seed, d.outcome))
        if d.rival != PAPER:
            sides.append((d.problem, d.calibrator, d.rival, d.agent, d.seed, -d.outcome))
    frame = pd.DataFrame(sides, columns=[*_PAIR, "seed", "outcome"]).drop_duplicates()
    twice = frame[frame.duplicated([*_PAIR, "seed"])]
    if len(twice):
        raise SettingsError(f"two different outcomes of one duel: {twice.iloc[0].to_dict()}")
    names = [PAPER, *in_order(frame["agent"])]
    for column in ("agent", "rival"):
        frame[column] = pd.Categorical(frame[column], categories=names, ordered=True)
    groups = frame.groupby(_PAIR, observed=True)["outcome"]
    rows = [dict(zip(_PAIR, pair, strict=True)) | _count(list(found)) for pair, found in groups]
    return pd.DataFrame(rows, columns=[*_PAIR, *_count([0])])


def duel_table(duels: Iterable[Duel]) -> list[dict[str, Any]]:
    """Return the rows of `duel_rows` as plain data, for JSON and CSV.

    Raises:
        SettingsError: See `duel_rows`.
    """
    return [{str(k): v for k, v in row.items()} for row in duel_rows(duels).to_dict("records")]


def _count(outcomes: list[int]) -> dict[str, float]:
    wins, ties, losses = (outcomes.count(k) for k in (-1, 0, 1))
    n = len(outcomes)
    interval = binomtest(wins, n).proportion_ci(CONFIDENCE, method="exact")
    p = float(binomtest(wins, wins + losses).pvalue) if wins + losses else 1.0
    ends = {"low": float(interval.low), "high": float(interval.high)}
    return {"seeds": n, "wins": wins, "ties": ties, "losses": losses, "share": wins / n} | ends | {"p": p}
