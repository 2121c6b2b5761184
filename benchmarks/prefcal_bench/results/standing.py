"""Rank agents over all problems."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from .campaign import Campaign, Setting, problems_of
from .statistics import FLOOR

SIGNIFICANCE = 0.05


@dataclass(frozen=True)
class Ranking:
    """Ranks of the agents' median final gaps, 1 for the smallest; equal medians share ranks.

    Args:
        agents: Agents with results on at least half of the problems, best average rank first.
        problems: Problems that they were ranked by, on which all of them share a seed.
        ranks: Rank of each agent on each problem.
        critical: Smallest difference of average ranks that is significant (5 %).
        p: p value of Friedman's test that all agents are alike; None for fewer than three agents.
        left_out: Agents and problems that are left out, and why.
    """

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


def rank(campaign: Campaign, setting: Setting) -> Ranking | str:
    """Return a ranking by the seeds that all agents of a setting have, or why there is none.

    Gaps below `FLOOR` are equal.
    """
    from scipy.stats import friedmanchisquare, rankdata

    studies = campaign.of(setting, "gap")
    counts = studies.groupby("agent", observed=True)["problem"].nunique()
    every = list(problems_of(studies))
    agents = [agent for agent, count in counts.items() if 2 * count >= len(every)]
    left_out = [
        f"{agent}: it has results on {count} of {len(every)} problems only"
        for agent, count in counts.items()
        if agent not in agents
    ]
    gaps = studies.assign(end=studies["gap"].map(lambda gap: gap[-1]).astype(float)).pivot_table(
        index=["problem", "seed"], columns="agent", values="end", observed=True
    )
    paired = gaps[agents].dropna()  # seeds that all agents have
    shared = set(paired.index.get_level_values("problem"))
    problems = [problem for problem in every if problem in shared]
    for problem in every if agents else ():
        lacking = [agent for agent in agents if gaps.loc[problem, agent].isna().all()]
        if lacking:
            left_out.append(f"{problem}: no results of {', '.join(lacking)}")
        elif problem not in shared:
            left_out.append(f"{problem}: no seed that all agents have")
    if len(agents) < 2 or len(problems) < 2:
        return (
            "a ranking needs two agents and two problems in common, "
            f"there are {len(agents)} and {len(problems)}"
        )
    medians = paired.groupby(level="problem", observed=True).median().loc[problems].to_numpy()
    ranks = rankdata(np.maximum(medians, FLOOR), axis=1)
    p = None
    if len(agents) > 2:  # if all are alike on every problem, there is nothing to test
        alike = bool((ranks == ranks[:, :1]).all())
        p = 1.0 if alike else float(friedmanchisquare(*ranks.T).pvalue)
    order = np.argsort(ranks.mean(axis=0), kind="stable")
    critical = critical_difference(len(agents), len(problems))
    best_first = tuple(agents[i] for i in order)
    return Ranking(best_first, tuple(problems), ranks[:, order], critical, p, tuple(left_out))
