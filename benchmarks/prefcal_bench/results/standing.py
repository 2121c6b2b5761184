"""Rank agents over all problems, and tell the share of studies that each has solved."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from .campaign import Campaign
from .curves import Setting
from .statistics import FLOOR

SIGNIFICANCE = 0.05
TOLERANCES = (1e-1, 1e-2, 1e-3)


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
        setting: Setting of all its results.
        agents: Agents, best average rank first.
        problems: Problems that they were ranked by.
        ranks: Rank of each agent on each problem.
        critical: Smallest difference of average ranks that is significant (5 %).
        p: p value of Friedman's test that all agents are alike; None for fewer than three agents.
        left_out: Agents and problems that are left out, and why.
    """

    setting: Setting
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

    shared = common(campaign, setting)
    agents, problems = shared.agents, tuple(shared.seeds)
    if len(agents) < 2 or len(problems) < 2:
        return (
            "a ranking needs two agents and two problems in common, "
            f"there are {len(agents)} and {len(problems)}"
        )
    gaps = campaign.costly(setting).pivot_table(
        index=["problem", "seed"], columns="agent", values="gap", observed=True
    )
    paired = gaps[list(agents)].dropna()  # seeds that all agents have
    medians = paired.groupby(level="problem", observed=True).median().loc[list(problems)].to_numpy()
    ranks = rankdata(np.maximum(medians, FLOOR), axis=1)
    p = None
    if len(agents) > 2:  # if all are alike on every problem, there is nothing to test
        alike = bool((ranks == ranks[:, :1]).all())
        p = 1.0 if alike else float(friedmanchisquare(*ranks.T).pvalue)
    order = np.argsort(ranks.mean(axis=0), kind="stable")
    return Ranking(
        setting=setting,
        agents=tuple(agents[i] for i in order),
        problems=problems,
        ranks=ranks[:, order],
        critical=critical_difference(len(agents), len(problems)),
        p=p,
        left_out=shared.left_out,
    )


def common(campaign: Campaign, setting: Setting, *, failed_too: bool = False) -> Common:
    """Find the studies by which all agents can be compared fairly.

    Args:
        campaign: All results.
        setting: Setting to compare in.
        failed_too: Whether to include seeds in which an agent failed.
    """
    problems = campaign.problems(setting, cost=True)
    studies = campaign.studies if failed_too else campaign.finished
    studies = studies[(studies["setting"] == setting) & studies["problem"].isin(problems)]
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


@dataclass(frozen=True)
class Profiles:
    """Share of (problem, seed) pairs that are solved after each experiment.

    A pair is solved to a tolerance if the gap of the θ that the agent would return is at most that
    share of the initial gap: the median gap of the first θ of that problem, over agents and seeds.

    Source: Moré and Wild (2009), Benchmarking derivative-free optimization algorithms.
    Deviation: experiments are not divided by the number of knobs plus one; under noise a share
        can fall again, because the agent's incumbent can change for the worse.

    Args:
        setting: Setting of all its results.
        shares: Share by tolerance and agent, shape (n_max,), each from 0 to 1. A failed cell is
            never solved.
        problems: Number of problems.
        instances: Number of (problem, seed) pairs.
        left_out: Agents and problems that are left out, and why.
    """

    setting: Setting
    shares: Mapping[float, Mapping[str, Float[np.ndarray, " n_max"]]]
    problems: int
    instances: int
    left_out: tuple[str, ...] = ()


def profiles(campaign: Campaign, setting: Setting) -> Profiles | str:
    """Return the data profiles of a setting, or the reason why there are none.

    A gap of at most `FLOOR` is solved to any tolerance.
    """
    shared = common(campaign, setting, failed_too=True)
    if not shared.seeds:
        return "a data profile needs a problem with a cost that the agents have in common"
    studies = campaign.costly(setting)
    initial = studies.assign(first=studies["curve"].str[0]).groupby("problem", observed=True)
    scale = np.maximum(initial["first"].median(), FLOOR)  # shared: no agent gains by luck
    curves = studies.set_index(["agent", "problem", "seed"])["curve"].to_dict()
    unsolved = np.full(setting.n_max, np.inf)
    places = [(problem, seed) for problem, seeds in shared.seeds.items() for seed in seeds]
    relative = {
        agent: np.array([
            np.where(gaps <= FLOOR, 0.0, gaps / scale[problem])
            for problem, seed in places
            for gaps in [curves.get((agent, problem, seed), unsolved)]
        ])
        for agent in shared.agents
    }  # fmt: skip
    return Profiles(
        setting=setting,
        shares={
            t: {agent: np.mean(gaps <= t, axis=0) for agent, gaps in relative.items()}
            for t in TOLERANCES
        },
        problems=len(shared.seeds),
        instances=len(places),
        left_out=shared.left_out,
    )
