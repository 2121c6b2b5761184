"""Describe what a campaign lacks, so that a table does not look complete when it is not."""

from collections.abc import Iterator
from itertools import groupby

import numpy as np
import pandas as pd

from prefcal_bench.problems import HOLES

from .campaign import Campaign, Setting, problems_of
from .statistics import FLOOR
from .words import named, problem_name, seeds_text, short

HOLE_SLACK = 1e-3  # depth below 0 beyond which a gap lies in a hole, above the error of best known values


def missing(campaign: Campaign) -> list[str]:
    """Return the seeds that an agent lacks, neither finished nor failed, but another agent has."""
    found = []
    for setting, problem, there in _tried(campaign):
        lacking: dict[tuple[int, ...], list[str]] = {}
        expected = set().union(*there.values())
        for agent, seeds in there.items():
            if seeds and seeds != expected:
                lacking.setdefault(tuple(sorted(expected - seeds)), []).append(agent)
        where = f"{problem}, {named(setting, campaign)}"
        found += [f"{where}: no {seeds_text(s)} of {', '.join(a)}" for s, a in lacking.items()]
    return found


def not_run(campaign: Campaign) -> list[str]:
    """Return where agents did not run at all, for example because they need a cost."""
    absent = [
        (setting, agent, problem)
        for setting, problem, there in _tried(campaign)
        for agent, seeds in there.items()
        if not seeds
    ]
    places: dict[tuple[Setting, tuple[str, ...]], list[str]] = {}
    absent.sort(key=lambda one: (campaign.settings.index(one[0]), campaign.agents.index(one[1])))
    for (setting, agent), rows in groupby(absent, lambda one: one[:2]):
        places.setdefault((setting, tuple(problem for *_, problem in rows)), []).append(agent)
    found = []
    for (setting, names), agents in places.items():
        where = named(setting, campaign)
        if names != problems_of(campaign.ours[campaign.ours["setting"] == setting]):
            where = f"{', '.join(names)}, {where}"
        found.append(f"{where}: not run with {', '.join(agents)}")
    return found


def failures(campaign: Campaign) -> list[tuple[str, str]]:
    """Return the failed cells and the reasons."""
    return [
        (f"{r.agent} on {r.problem}, {r.setting.calibrator}, seed {r.seed}", r.failure)
        for r in campaign.failed.itertuples()
    ]


def beaten(campaign: Campaign) -> list[str]:
    """Return the problems on which the best known value was beaten by more than `FLOOR`.

    Known holes are excluded; see `in_holes`.
    """
    costly = _costly(campaign)
    news = costly[~costly["hole"] & (costly["lowest"] < -FLOOR)]
    least = news.groupby("problem", observed=True)["lowest"].min()
    return [
        f"{problem_name(campaign, p)}: {-gap:.2g} below the best known value, which is therefore "
        "not the optimum; such gaps count as the floor"
        for p, gap in least.items()
    ]


def in_holes(campaign: Campaign) -> list[str]:
    """Return which agents ended in an undesirable hole of a cost, and how often."""
    found = []
    for (setting, problem), group in _costly(campaign).groupby(["setting", "problem"], observed=True):
        counts = group.groupby("agent", observed=True)["hole"].agg(["sum", "count"])
        who = [f"{a} in {n} of {of} seeds" for a, n, of in counts.itertuples() if n]
        if who:
            found.append(
                f"{problem}, {named(setting, campaign)}: found the hole of the "
                f"cost, up to {short(HOLES[problem])} below the basin that gaps are measured "
                f"from: {', '.join(who)}; such gaps count as the floor"
            )
    return found


def _costly(campaign: Campaign) -> pd.DataFrame:
    """Return the studies with gaps, their smallest gap, and whether they end in a known hole."""
    costly = campaign.finished.dropna(subset="gap")
    end, low = (costly["gap"].map(one).astype(float) for one in (lambda gap: gap[-1], np.min))
    depth = costly["problem"].astype(str).map(HOLES).astype(float)
    hole = (end < -HOLE_SLACK) & (end >= -depth - HOLE_SLACK)
    return costly.assign(hole=hole, lowest=np.fmin(low, costly["visited"].astype(float)))


def _tried(campaign: Campaign) -> Iterator[tuple[Setting, str, dict[str, set[int]]]]:
    """Yield the seeds of each of our agents, for each setting and problem."""
    ours = [agent for agent in campaign.agents if agent in set(campaign.ours["agent"])]
    for (setting, problem), there in campaign.ours.groupby(["setting", "problem"], observed=True):
        seeds = there.groupby("agent", observed=True)["seed"].agg(set)
        yield setting, problem, {agent: seeds.get(agent, set()) for agent in ours}
