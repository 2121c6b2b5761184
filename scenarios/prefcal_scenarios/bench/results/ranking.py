"""Rank agents over all problems by the studies that all of them have."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from .campaign import Campaign, Regime
from .statistics import FLOOR

SIGNIFICANCE = 0.05


@dataclass(frozen=True, slots=True)
class Common:
    """Agents, problems with a cost, and the seeds that all these agents have there.

    Args:
        agents: Agents with results on at least half of the problems.
        seeds: Seeds by problem, for problems on which all those agents share a seed.
        left_out: Agents and problems that are left out, and why.
    """

    agents: tuple[str, ...]
    seeds: Mapping[str, tuple[int, ...]]
    left_out: tuple[str, ...]


@dataclass(frozen=True)
class Ranking:
    """Ranks of the agents' median final gaps, 1 for the smallest; equal medians share ranks.

    Args:
        regime: Regime of all its results.
        agents: Agents, best average rank first.
        problems: Problems that they were ranked by.
        ranks: Rank of each agent on each problem.
        critical: Smallest difference of average ranks that is significant (5 %).
        p: p value of Friedman's test that all agents are alike; None for fewer than three agents.
        left_out: Agents and problems that are left out, and why.
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
        """Return the average rank of each agent."""
        return np.asarray(self.ranks.mean(axis=0))


def critical_difference(agents: int, problems: int) -> float:
    """Return Nemenyi's critical difference of average ranks at 5 %, for 2 agents or more.

    Source: Demšar (2006), Statistical comparisons of classifiers over multiple data sets.
    """
    from scipy.stats import studentized_range

    q = studentized_range.ppf(1 - SIGNIFICANCE, agents, np.inf) / np.sqrt(2)
    return float(q * np.sqrt(agents * (agents + 1) / (6 * problems)))


def rank(campaign: Campaign, regime: Regime, floor: float = FLOOR) -> Ranking | str:
    """Return a ranking by the seeds that all agents of a regime have, or why there is none.

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
    gaps = campaign.costly(regime).pivot_table(
        index=["problem", "seed"], columns="agent", values="gap", observed=True
    )
    paired = gaps[list(agents)].dropna()  # seeds that all agents have
    medians = paired.groupby(level="problem", observed=True).median().loc[list(problems)].to_numpy()
    ranks = rankdata(np.maximum(medians, floor), axis=1)
    p = None
    if len(agents) > 2:  # if all are alike on every problem, there is nothing to test
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


def common(campaign: Campaign, regime: Regime, *, failed_too: bool = False) -> Common:
    """Find the studies by which all agents can be compared fairly.

    Args:
        campaign: All results.
        regime: Regime to compare in.
        failed_too: Whether to include seeds in which an agent failed.
    """
    problems = campaign.problems(regime, cost=True)
    studies = campaign.studies if failed_too else campaign.finished
    studies = studies[(studies["regime"] == regime) & studies["problem"].isin(problems)]
    counts = studies.groupby("agent", observed=True)["problem"].nunique()
    agents = [a for a, count in counts.items() if 2 * count >= len(problems)]
    left_out = [
        f"{agent}: it has results on {count} of {len(problems)} problems only"
        for agent, count in counts.items()
        if agent not in agents
    ]
    seeds = {}
    for problem in problems if agents else ():
        there = studies[studies["problem"] == problem].groupby("agent", observed=True)["seed"]
        tried = there.agg(frozenset)
        lacking = [agent for agent in agents if agent not in tried]
        shared = frozenset.intersection(*(tried.get(agent, frozenset()) for agent in agents))
        if shared:
            seeds[problem] = tuple(sorted(shared))
        elif lacking:
            left_out.append(f"{problem}: no results of {', '.join(lacking)}")
        else:
            left_out.append(f"{problem}: no seed that all agents have")
    return Common(tuple(agents), seeds, tuple(left_out))
