"""Describe what a campaign lacks, so that a table does not look complete when it is not."""

from collections.abc import Iterator

import numpy as np
import pandas as pd

from prefcal_bench.problems import HOLES

from .campaign import Campaign
from .curves import Setting
from .statistics import FLOOR
from .words import named, problem_name, seeds_text, short

HOLE_SLACK = 1e-3
"""Depth below 0 beyond which a gap lies in a hole, above the error of best known values."""


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
    absent: dict[tuple[Setting, str], list[str]] = {}
    for setting, problem, there in _tried(campaign):
        for agent, seeds in there.items():
            if not seeds:
                absent.setdefault((setting, agent), []).append(problem)
    places: dict[tuple[Setting, tuple[str, ...]], list[str]] = {}
    for (setting, agent), problems in absent.items():
        places.setdefault((setting, tuple(problems)), []).append(agent)
    found = []
    for (setting, names), agents in places.items():
        where = named(setting, campaign)
        if names != campaign.problems(setting):
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
    costly = campaign.finished[campaign.finished["cost"]]
    lowest = costly.assign(gap=np.fmin(costly["curve"].map(np.min), costly["visited"]))
    news = lowest[~in_hole(lowest) & (lowest["gap"] < -FLOOR)]
    least = news.astype({"problem": str}).groupby("problem")["gap"].min()
    return [
        f"{problem_name(campaign, p)}: {-gap:.2g} below the best known value, which is therefore "
        "not the optimum; such gaps count as the floor"
        for p, gap in least.items()
    ]


def in_holes(campaign: Campaign) -> list[str]:
    """Return which agents ended in an undesirable hole of a cost, and how often."""
    costly = campaign.finished[campaign.finished["cost"]]
    studies = costly.assign(hole=in_hole(costly))
    found = []
    for (setting, problem), group in studies.groupby(["setting", "problem"], observed=True):
        counts = group.groupby("agent", observed=True)["hole"].agg(["sum", "count"])
        who = [f"{a} in {n} of {of} seeds" for a, n, of in counts.itertuples() if n]
        if who:
            found.append(
                f"{problem}, {named(setting, campaign)}: found the hole of the "
                f"cost, up to {short(HOLES[problem])} below the basin that gaps are measured "
                f"from: {', '.join(who)}; such gaps count as the floor"
            )
    return found


def in_hole(studies: pd.DataFrame) -> pd.Series:
    """Return for each study whether its gap lies in a known hole of the cost."""
    depth = studies["problem"].astype(str).map(HOLES).astype(float)
    gap = studies["gap"]
    return (gap < -HOLE_SLACK) & (gap >= -depth - HOLE_SLACK)


def _tried(campaign: Campaign) -> Iterator[tuple[Setting, str, dict[str, set[int]]]]:
    """Yield the seeds of every agent of the campaign, for each setting and problem."""
    where = campaign.studies.groupby(["setting", "problem"], observed=True)
    for (setting, problem), studies in where:
        seeds = studies.groupby("agent", observed=True)["seed"].agg(set)
        yield setting, problem, {agent: seeds.get(agent, set()) for agent in campaign.agents}
