"""Data profiles: which share of all studies has come how near, after how many experiments."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from prefcal_scenarios.bench.results.campaign import Campaign, Regime, curve
from prefcal_scenarios.bench.results.common import common
from prefcal_scenarios.bench.results.statistics import FLOOR

TOLERANCES = (1e-1, 1e-2, 1e-3)


@dataclass(frozen=True)
class Profiles:
    """Shares of the (problem, seed) that are solved after each experiment.

    Solved to a tolerance: the gap of what the agent would return is at most that share of the
    initial gap, the median over agents and seeds of the gap of the very first θ of that problem.

    Source: Moré and Wild (2009), Benchmarking derivative-free optimization algorithms.
    Deviation: experiments are not divided by the number of knobs plus one; under noise a share
        may fall again, because the agent's incumbent can.

    Args:
        regime: Of all its results.
        shares: By tolerance and agent, shape (n_max,), each from 0 to 1. A failed cell is never
            solved.
        problems: How many.
        instances: How many (problem, seed).
        left_out: In words, which agents and problems are not in it, and why.
    """

    regime: Regime
    shares: Mapping[float, Mapping[str, Float[np.ndarray, " n_max"]]]
    problems: int
    instances: int
    left_out: tuple[str, ...] = ()


def profiles(
    campaign: Campaign,
    regime: Regime,
    tolerances: tuple[float, ...] = TOLERANCES,
    floor: float = FLOOR,
) -> Profiles | str:
    """Make the data profiles of a regime; a str says why there are none.

    A gap of `floor` or less solves to any tolerance.
    """
    shared = common(campaign, regime, failed_too=True)
    if not shared.seeds:
        return "a data profile needs a problem with a cost that the agents have in common"
    relative: dict[str, list[Float[np.ndarray, " n"]]] = {a: [] for a in shared.agents}
    for problem, seeds in shared.seeds.items():
        runs = {a: campaign.runs(regime, problem, a) for a in shared.agents}
        initial = _initial(campaign, regime, problem)
        for agent, found in runs.items():
            for seed in seeds:
                gaps = curve(found[seed]) if seed in found else np.full(regime.n_max, np.inf)
                relative[agent].append(np.where(gaps <= floor, 0.0, gaps / max(initial, floor)))
    return Profiles(
        regime=regime,
        shares={
            t: {a: np.mean(np.array(gaps) <= t, axis=0) for a, gaps in relative.items()}
            for t in tolerances
        },
        problems=len(shared.seeds),
        instances=sum(map(len, shared.seeds.values())),
        left_out=shared.left_out,
    )


def _initial(campaign: Campaign, regime: Regime, problem: str) -> float:
    """The gap that a first θ has, one number for all, so that nobody is judged by his luck."""
    found = [campaign.runs(regime, problem, agent) for agent in campaign.agents]
    return float(np.median([curve(run)[0] for runs in found for run in runs.values()]))
