"""Count duels: how often one agent's θ is preferred to another's, and with which confidence."""

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any

import pandas as pd

from prefcal_bench.cells.duels import PAPER, Duel
from prefcal_bench.cells.roster import in_order
from prefcal_env.errors import SettingsError

from .statistics import CONFIDENCE

_PAIR = ["problem", "calibrator", "agent", "rival"]


@dataclass(frozen=True, slots=True)
class Tally:
    """All duels of an agent with a rival on one problem.

    Args:
        problem: Name of a problem without a cost.
        calibrator: Name of the calibrator that answered in the studies.
        agent: Name of the agent whose θ is evaluated.
        rival: Name of another agent, or `PAPER`.
        seeds: Number of duels.
        wins: Number of duels in which the agent's θ is preferred.
        ties: Number of duels in which neither θ is preferred.
        losses: Number of duels in which the rival's θ is preferred.
        share: wins / seeds.
        low: Lower end of the exact (Clopper-Pearson) 95 % interval of that share.
        high: Upper end of that interval.
        p: p value of an exact two-sided sign test on wins and losses; 1 if all are ties.
    """

    problem: str
    calibrator: str
    agent: str
    rival: str
    seeds: int
    wins: int
    ties: int
    losses: int
    share: float
    low: float
    high: float
    p: float

    @property
    def net(self) -> float:
        """Return the share of wins minus the share of losses, from -1 to 1."""
        return (self.wins - self.losses) / self.seeds


def tallies(duels: Iterable[Duel]) -> list[Tally]:
    """Return the counts of all duels, each from both sides; duplicates count once.

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
    return [_tally(pair, list(outcomes)) for pair, outcomes in groups]


def duel_table(duels: Iterable[Duel]) -> list[dict[str, Any]]:
    """Return the tallies as plain data, for JSON and CSV.

    Raises:
        SettingsError: See `tallies`.
    """
    return [asdict(t) for t in tallies(duels)]


def _tally(key: tuple[str, str, str, str], outcomes: list[int]) -> Tally:
    from scipy.stats import binomtest

    wins, ties, losses = (outcomes.count(k) for k in (-1, 0, 1))
    n = len(outcomes)
    interval = binomtest(wins, n).proportion_ci(CONFIDENCE, method="exact")
    p = float(binomtest(wins, wins + losses).pvalue) if wins + losses else 1.0
    low, high = float(interval.low), float(interval.high)
    return Tally(*key, n, wins, ties, losses, wins / n, low, high, p)
