"""What duels say: how often one agent's θ is preferred to another's, and how sure that is."""

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any

from prefcal_env.errors import SettingsError
from prefcal_scenarios.bench.duels import PAPER, Duel
from prefcal_scenarios.bench.results.statistics import CONFIDENCE
from prefcal_scenarios.bench.roster import in_order


@dataclass(frozen=True, slots=True)
class Tally:
    """All duels of an agent with a rival on one problem.

    Args:
        problem: One without a cost.
        calibrator: The one that the studies were answered by.
        agent: Whose θ is judged.
        rival: Another agent, or `PAPER`.
        seeds: Duels.
        wins: Of these, the agent's θ is preferred.
        ties: Neither is.
        losses: The rival's is.
        share: wins / seeds.
        low: Lower end of the exact (Clopper-Pearson) 95 % interval of that share.
        high: Upper end.
        p: Of an exact sign test on wins and losses, two-sided; 1 if all are ties.
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
        """Share of wins minus share of losses, from -1 to 1."""
        return (self.wins - self.losses) / self.seeds


def tallies(duels: Iterable[Duel]) -> list[Tally]:
    """Count duels, each from both sides; a duel that is there twice counts once.

    Raises:
        SettingsError: no `Duel`, an impossible outcome, an agent against itself, or two outcomes
            of one duel.
    """
    outcomes: dict[tuple[str, str, str, str, int], int] = {}
    for duel in duels:
        _check(duel)
        sides = [(duel.agent, duel.rival, duel.outcome)]
        if duel.rival != PAPER:
            sides.append((duel.rival, duel.agent, -duel.outcome))
        for agent, rival, outcome in sides:
            key = (duel.problem, duel.calibrator, agent, rival, duel.seed)
            if outcomes.setdefault(key, outcome) != outcome:
                raise SettingsError(f"two different outcomes of one duel: {duel}")
    groups: dict[tuple[str, str, str, str], list[int]] = {}
    for (problem, calibrator, agent, rival, _), outcome in outcomes.items():
        groups.setdefault((problem, calibrator, agent, rival), []).append(outcome)
    places = {name: i for i, name in enumerate((PAPER, *in_order({k[2] for k in groups})))}
    ordered = sorted(groups, key=lambda k: (k[0], k[1], places[k[2]], places[k[3]]))
    return [_tally(key, groups[key]) for key in ordered]


def duel_table(duels: Iterable[Duel]) -> list[dict[str, Any]]:
    """The tallies as plain data, for JSON and CSV.

    Raises:
        SettingsError: see `tallies`.
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


def _check(duel: Duel) -> None:
    if not isinstance(duel, Duel):
        raise SettingsError(f"duels must be of type Duel, got {duel!r}")
    if duel.outcome not in (-1, 0, 1):
        raise SettingsError(f"the outcome of a duel must be -1, 0 or 1, got {duel}")
    if duel.agent in (duel.rival, PAPER):
        raise SettingsError(f"a duel is that of an agent with somebody else, got {duel}")
