"""Count duels: how often one agent's θ is preferred to another's, and with which confidence."""

from collections.abc import Iterable
from typing import Any

import pandas as pd

from prefcal_bench.cells.duels import PAPER, Duel
from prefcal_bench.cells.roster import in_order
from prefcal_env.errors import SettingsError

from .statistics import CONFIDENCE

_PAIR = ["problem", "calibrator", "agent", "rival"]


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
    from scipy.stats import binomtest

    wins, ties, losses = (outcomes.count(k) for k in (-1, 0, 1))
    n = len(outcomes)
    interval = binomtest(wins, n).proportion_ci(CONFIDENCE, method="exact")
    p = float(binomtest(wins, wins + losses).pvalue) if wins + losses else 1.0
    ends = {"low": float(interval.low), "high": float(interval.high)}
    return {"seeds": n, "wins": wins, "ties": ties, "losses": losses, "share": wins / n} | ends | {"p": p}
