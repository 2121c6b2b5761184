"""A ranking of agents over all problems, with how far apart ranks must be to mean something."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from prefcal_scenarios.bench.results.campaign import Campaign, Regime, curve
from prefcal_scenarios.bench.results.common import common
from prefcal_scenarios.bench.results.statistics import FLOOR

SIGNIFICANCE = 0.05


@dataclass(frozen=True)
class Ranking:
    """Ranks of the agents' median final gaps, 1 the nearest; equal medians share their ranks.

    Args:
        regime: Of all its results.
        agents: Best average rank first.
        problems: By which they were ranked.
        ranks: Of each problem and agent.
        critical: Two agents whose average ranks differ by less are not told apart (5 %).
        p: Of Friedman's test that all agents are alike; None with fewer than three of them.
        left_out: In words, which agents and problems are not in it, and why.
    """

    regime: Regime
    agents: tuple[str, ...]
    problems: tuple[str, ...]
    ranks: Float[np.ndarray, "P A"]
    critical: float
    p: float | None
    left_out: tuple[str, ...] = ()

    @property
    def average(self) -> Float[np.ndarray, " A"]:
        """Average rank of each agent."""
        return np.asarray(self.ranks.mean(axis=0))


def critical_difference(agents: int, problems: int) -> float:
    """Nemenyi's critical difference of average ranks at 5 %, for 2 agents or more.

    Source: Demšar (2006), Statistical comparisons of classifiers over multiple data sets.
    """
    from scipy.stats import studentized_range

    q = studentized_range.ppf(1 - SIGNIFICANCE, agents, np.inf) / np.sqrt(2)
    return float(q * np.sqrt(agents * (agents + 1) / (6 * problems)))


def rank(campaign: Campaign, regime: Regime, floor: float = FLOOR) -> Ranking | str:
    """Rank the agents of a regime by the seeds that all have; a str says why there is no ranking.

    Gaps below `floor` are equal.
    """
    from scipy.stats import friedmanchisquare, rankdata

    shared = common(campaign, regime)
    agents, problems = shared.agents, tuple(shared.seeds)
    if len(agents) < 2 or len(problems) < 2:
        return (
            "a ranking needs two agents and two problems in common, "
            f"there are {len(agents)} and {len(problems)}"
        )
    medians = np.array(
        [
            [
                np.median([curve(campaign.runs(regime, p, a)[s])[-1] for s in shared.seeds[p]])
                for a in agents
            ]
            for p in problems
        ]
    )
    ranks = rankdata(np.maximum(medians, floor), axis=1)
    p = None
    if len(agents) > 2:  # all alike on every problem: nothing to test
        alike = bool((ranks == ranks[:, :1]).all())
        p = 1.0 if alike else float(friedmanchisquare(*ranks.T).pvalue)
    order = np.argsort(ranks.mean(axis=0), kind="stable")
    return Ranking(
        regime=regime,
        agents=tuple(agents[i] for i in order),
        problems=problems,
        ranks=ranks[:, order],
        critical=critical_difference(len(agents), len(problems)),
        p=p,
        left_out=shared.left_out,
    )
