"""What agents of one regime have in common, so that all are judged by the same cells."""

from collections.abc import Mapping
from dataclasses import dataclass

from prefcal_scenarios.bench.results.campaign import Campaign, Regime


@dataclass(frozen=True, slots=True)
class Common:
    """Agents, problems with a cost, and the seeds that all these agents have there.

    Args:
        agents: Those with results on at least half of the problems.
        seeds: By problem; only problems on which all those agents have a seed in common.
        left_out: In words, what is not among them and why.
    """

    agents: tuple[str, ...]
    seeds: Mapping[str, tuple[int, ...]]
    left_out: tuple[str, ...]


def common(campaign: Campaign, regime: Regime, *, failed_too: bool = False) -> Common:
    """Find the cells that are fair to compare all agents by.

    Args:
        campaign: All results.
        regime: Which of them.
        failed_too: Whether a seed counts that some agent failed in.
    """
    problems = campaign.problems(regime, cost=True)
    tried = {
        (p, a): set(campaign.runs(regime, p, a))
        | (set(campaign.failures(regime, p, a)) if failed_too else set())
        for p in problems
        for a in campaign.agents
    }
    left_out, agents = [], []
    for agent in campaign.agents:
        count = sum(bool(tried[p, agent]) for p in problems)
        if count and 2 * count >= len(problems):
            agents.append(agent)
        elif count:
            left_out.append(f"{agent}: it has results on {count} of {len(problems)} problems only")
    seeds = {}
    for p in problems if agents else ():
        shared = set.intersection(*(tried[p, a] for a in agents))
        if shared:
            seeds[p] = tuple(sorted(shared))
        elif lacking := [a for a in agents if not tried[p, a]]:
            left_out.append(f"{p}: no results of {', '.join(lacking)}")
        else:
            left_out.append(f"{p}: no seed that all agents have")
    return Common(tuple(agents), seeds, tuple(left_out))
