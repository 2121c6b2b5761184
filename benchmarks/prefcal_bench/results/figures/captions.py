"""Captions of the figures, and their alternative texts for people who cannot see them."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from prefcal_bench.cells.duels import PAPER
from prefcal_bench.results.curves import Curves, Setting
from prefcal_bench.results.duelling import Tally
from prefcal_bench.results.standing import Profiles, Ranking
from prefcal_bench.results.tables import Worths
from prefcal_bench.results.words import percent, plain_number, probability, short

RANKING = (
    "Agents ranked on each problem by the median of their gaps at the end, over the seeds that all "
    "of them have. The marker is the average rank, the bar half a critical difference (Nemenyi, "
    "5 %) to each side: two agents whose bars do not overlap differ significantly; shaded is the "
    "bar of the best. Pale dots: how often an agent had that rank. With few problems this is rough."
)
GAPS = (
    "True gap to the best known value, without noise, of the θ that an agent would return if it "
    "were stopped there. Line: median over the seeds. Band, and bars to the right for the end: the "
    "middle half of the seeds. Lower is better; the scales differ."
)
QUESTIONS = (
    "The same gap against the number of comparisons that had to be answered. An agent that "
    "sees values asks none; its median at the end is a dashed line."
)
DUELS = (
    "Share of seeds in which what the row's agent returned is preferred to the column's, by the "
    "criteria without noise; below it wins, ties and losses. Blue: the row wins more often than it "
    "loses, orange: less often."
)
SECONDS = (
    "From serial runs only: time from an answer to the next θ, near the end of a study. Marker: "
    "median over the problems; pale: each problem, and the middle half of them."
)
WORTH = (
    "The worth of a θ is how many random experiments it takes on average to find one at least as "
    "good, by the taste without noise."
)
SUMMARY = (
    f"{WORTH} Marker: geometric mean over loops and seeds of the θ that the agent returns; bar: "
    "its 95 % bootstrap interval over the seeds of each loop. Dashed: random search in theory. "
    "Hollow: agents that are told values in place of answers."
)
DRIFT = (
    f"{WORTH} Line: geometric mean over loops and seeds of the θ that the agent would return if it "
    "were stopped there. To the right, a bar leads from the worth at the end up to that of the "
    "best θ that the agent held before: a long bar means that good θ were lost again."
)
WORTH_BY_EXPERIMENTS = (
    "Worth of the θ that an agent would return if it were stopped there. Line: geometric mean over "
    "the seeds; bars to the right, at the end: the middle half of the seeds. Higher is better."
)
WORTH_BY_ANSWERS = (
    "The same worth against the number of comparisons that had to be answered; bars to the right: "
    "at the end of the study, even if it is beyond the right edge. An agent that sees values asks "
    "none; its mean at the end is a dashed line."
)


def profiles_caption(found: Profiles) -> str:
    """Return the caption of the data profiles."""
    return (
        f"Share of the {found.instances} pairs of problem and seed (problems: {found.problems}) "
        "in which the gap of the θ that the agent would return has fallen to that part of the "
        "initial gap, which is the median gap of a first θ on that problem and the same for all "
        "agents. A failed study is not solved."
    )


def profiles_alt(found: Profiles) -> str:
    """Return a description of the shares at the end."""
    ends = [
        f"to {100 * tolerance:g} % of the initial gap: "
        + ", ".join(f"{a} {percent(s[-1])}" for a, s in shares.items())
        for tolerance, shares in found.shares.items()
    ]
    return f"Data profiles. Solved after {found.setting.n_max} experiments, {'; '.join(ends)}."


def ranking_alt(found: Ranking) -> str:
    """Return a description of the average ranks."""
    pairs = zip(found.agents, found.average, strict=True)
    ranks = ", ".join(f"{agent} {average:.2f}" for agent, average in pairs)
    test = "" if found.p is None else f"; Friedman's test p {probability(found.p)}"
    return (
        f"Average ranks over {len(found.problems)} problems: {ranks}. "
        f"Critical difference {found.critical:.2f}{test}."
    )


def gaps_alt(rows: pd.DataFrame, what: str) -> str:
    """Return a description that names the agent with the lowest final median on each problem."""
    lowest = rows.loc[
        rows["gap_median"].astype(float).groupby(rows["problem"], sort=False).idxmin()
    ]
    texts = [f"{r.problem} {r.agent} ({short(r.gap_median)})" for r in lowest.itertuples()]
    return f"Plots of the gap against {what}. Lowest median gap at the end: {', '.join(texts)}."


def duels_alt(tallies: Sequence[Tally]) -> str:
    """Return how often each agent is preferred to the paper's optimum, or else to other agents."""
    against = [t for t in tallies if t.rival == PAPER] or list(tallies)
    shares = ", ".join(f"{t.agent} to {t.rival} {percent(t.share)}" for t in against)
    return f"Heat map of who is preferred on {tallies[0].problem}. Share of seeds: {shares}."


def seconds_alt(measured: Mapping[str, Sequence[float]]) -> str:
    """Return a description of the median times."""
    medians = ", ".join(f"{a} {short(float(np.median(v)))} s" for a, v in measured.items())
    return f"Median time of a proposal: {medians}."


def improvement_caption(baseline: str) -> str:
    """Return the caption of the heat map of who beats the baseline."""
    return (
        f"Probability that the agent's θ is worth more than that of {baseline}, for one seed of "
        "each on any loop; a tie counts half. Small: its 95 % bootstrap interval, if there is "
        "room; bold if that interval excludes 50 %."
    )


def summary_alt(worths: Worths, settings: Sequence[Setting]) -> str:
    """Return a description of the worth at the end."""
    texts = _by_setting(settings, worths.ranked, lambda row: plain_number(row.worth))
    return f"Worth at the end. {texts}."


def improvement_alt(worths: Worths, settings: Sequence[Setting]) -> str:
    """Return a description of who beats the baseline."""
    texts = _by_setting(settings, worths.ended, lambda row: (
        None if row.improvement is None else f"{100 * row.improvement:.0f} %"))  # fmt: skip
    return f"Heat map of the probability to beat the baseline. {texts}."


def drift_alt(worths: Worths, settings: Sequence[Setting]) -> str:
    """Return a description of how much was lost."""
    texts = _by_setting(settings, worths.ended, lambda row: f"{row.drift:.1f}")
    return f"Plots of worth along the study. Best before over end: {texts}."


def _by_setting(
    settings: Sequence[Setting],
    rows: Callable[[Setting], pd.DataFrame],
    text: Callable[[Any], str | None],
) -> str:
    """Return a text of each agent that has one, by setting."""
    parts = []
    for setting in settings:
        told = [(row.agent, text(row)) for row in rows(setting).itertuples()]
        agents = ", ".join(f"{agent} {words}" for agent, words in told if words is not None)
        parts.append(f"{setting.name(settings)}: {agents or 'nobody'}")
    return "; ".join(parts)


def loops_alt(curves: Curves, setting: Setting) -> str:
    """Return a description that names the agent with the highest final median on each loop."""
    studies = curves.of(setting)
    ends = studies.assign(end=studies["worth"].map(lambda w: w[-1]).astype(float))
    means = ends.groupby(["loop", "agent"], observed=True)["end"].median().reset_index()
    best = means.loc[means.groupby("loop", observed=True)["end"].idxmax()]
    agents = ", ".join(f"{r.loop} {r.agent} ({plain_number(r.end)})" for r in best.itertuples())
    return f"Highest median worth at the end: {agents}."
