"""What a campaign lacks, in words: a table must not look complete when it is not."""

from collections.abc import Iterator

from prefcal_scenarios.bench.results.campaign import Campaign, Regime
from prefcal_scenarios.bench.results.words import problem_name, regime_name, seeds_text


def missing(campaign: Campaign) -> list[str]:
    """Cells that are neither finished nor failed, though others of their kind are there.

    An agent is expected wherever any agent was run, with every seed that any agent had there.
    """
    return [
        words
        for regime in campaign.regimes
        for problem in campaign.problems(regime)
        for words in _missing(campaign, regime, problem)
    ]


def failures(campaign: Campaign) -> list[tuple[str, str]]:
    """Failed cells and why they failed."""
    found = []
    for r in campaign.failed:
        c = r.cell
        found.append((f"{c.agent} on {c.problem}, {c.calibrator}, seed {c.seed}", r.failure))
    return found


def beaten(campaign: Campaign, slack: float) -> list[str]:
    """Problems on which something better than the best known was found, by more than `slack`."""
    lowest: dict[str, float] = {}
    for r in campaign:
        if r.gaps is not None:
            gap = min(*r.gaps, *(r.visited or r.gaps))
            lowest[r.cell.problem] = min(gap, lowest.get(r.cell.problem, gap))
    return [
        f"{problem_name(campaign, p)}: {-gap:.2g} below the best known value, which is not the "
        "optimum then; such gaps count as the floor"
        for p, gap in sorted(lowest.items())
        if gap < -slack
    ]


def _missing(campaign: Campaign, regime: Regime, problem: str) -> Iterator[str]:
    there = {
        a: {*campaign.runs(regime, problem, a), *campaign.failures(regime, problem, a)}
        for a in campaign.agents
    }
    expected = set().union(*there.values())
    where = f"{problem}, {regime_name(regime, campaign.regimes)}"
    absent = [a for a, seeds in there.items() if not seeds]
    if absent:
        yield f"{where}: not run with {', '.join(absent)}"
    lacking: dict[tuple[int, ...], list[str]] = {}
    for agent, seeds in there.items():
        if seeds and seeds != expected:
            lacking.setdefault(tuple(sorted(expected - seeds)), []).append(agent)
    for gone, agents in lacking.items():
        yield f"{where}: no {seeds_text(gone)} of {', '.join(agents)}"
