"""Data profiles: the share of solved studies against the number of experiments."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from .campaign import Campaign, Regime
from .ranking import common
from .statistics import FLOOR

TOLERANCES = (1e-1, 1e-2, 1e-3)


@dataclass(frozen=True)
class Profiles:
    """Share of (problem, seed) pairs that are solved after each experiment.

    A pair is solved to a tolerance if the gap of the θ that the agent would return is at most that
    share of the initial gap: the median gap of the first θ of that problem, over agents and seeds.

    Source: Moré and Wild (2009), Benchmarking derivative-free optimization algorithms.
    Deviation: experiments are not divided by the number of knobs plus one; under noise a share
        can fall again, because the agent's incumbent can change for the worse.

    Args:
        regime: Regime of all its results.
        shares: Share by tolerance and agent, shape (n_max,), each from 0 to 1. A failed cell is
            never solved.
        problems: Number of problems.
        instances: Number of (problem, seed) pairs.
        left_out: Agents and problems that are left out, and why.
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
    """Return the data profiles of a regime, or the reason why there are none.

    A gap of at most `floor` is solved to any tolerance.
    """
    shared = common(campaign, regime, failed_too=True)
    if not shared.seeds:
        return "a data profile needs a problem with a cost that the agents have in common"
    studies = campaign.costly(regime)
    initial = studies.assign(first=studies["curve"].str[0]).groupby("problem", observed=True)
    scale = np.maximum(initial["first"].median(), floor)  # shared: no agent gains by luck
    curves = studies.set_index(["agent", "problem", "seed"])["curve"].to_dict()
    unsolved = np.full(regime.n_max, np.inf)
    places = [(problem, seed) for problem, seeds in shared.seeds.items() for seed in seeds]
    relative = {
        agent: np.array([
            np.where(gaps <= floor, 0.0, gaps / scale[problem])
            for problem, seed in places
            for gaps in [curves.get((agent, problem, seed), unsolved)]
        ])
        for agent in shared.agents
    }  # fmt: skip
    return Profiles(
        regime=regime,
        shares={
            t: {agent: np.mean(gaps <= t, axis=0) for agent, gaps in relative.items()}
            for t in tolerances
        },
        problems=len(shared.seeds),
        instances=len(places),
        left_out=shared.left_out,
    )
