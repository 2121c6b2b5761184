"""What a campaign lacks, in words: a table must not look complete when it is not."""

from collections.abc import Iterator

from prefcal_scenarios.bench.problems import HOLES
from prefcal_scenarios.bench.results.campaign import Campaign, Regime, curve
from prefcal_scenarios.bench.results.words import problem_name, regime_name, seeds_text, short

HOLE_SLACK = 1e-3
"""A gap further below 0 than this lies in a hole; a best known value may be that wrong itself."""


def missing(campaign: Campaign) -> list[str]:
    """Seeds that an agent lacks, neither finished nor failed, though another agent has them."""
    found = []
    for regime, problem, there in _tried(campaign):
        lacking: dict[tuple[int, ...], list[str]] = {}
        expected = set().union(*there.values())
        for agent, seeds in there.items():
            if seeds and seeds != expected:
                lacking.setdefault(tuple(sorted(expected - seeds)), []).append(agent)
        where = f"{problem}, {regime_name(regime, campaign.regimes)}"
        found += [f"{where}: no {seeds_text(s)} of {', '.join(a)}" for s, a in lacking.items()]
    return found


def not_run(campaign: Campaign) -> list[str]:
    """Where agents were not run at all; often there is a reason, such as that they need a cost."""
    absent: dict[tuple[Regime, str], list[str]] = {}
    for regime, problem, there in _tried(campaign):
        for agent, seeds in there.items():
            if not seeds:
                absent.setdefault((regime, agent), []).append(problem)
    places: dict[tuple[Regime, tuple[str, ...]], list[str]] = {}
    for (regime, agent), problems in absent.items():
        places.setdefault((regime, tuple(problems)), []).append(agent)
    found = []
    for (regime, names), agents in places.items():
        where = regime_name(regime, campaign.regimes)
        if names != campaign.problems(regime):
            where = f"{', '.join(names)}, {where}"
        found.append(f"{where}: not run with {', '.join(agents)}")
    return found


def failures(campaign: Campaign) -> list[tuple[str, str]]:
    """Failed cells and why they failed."""
    found = []
    for r in campaign.failed:
        c = r.cell
        found.append((f"{c.agent} on {c.problem}, {c.calibrator}, seed {c.seed}", r.failure))
    return found


def beaten(campaign: Campaign, slack: float) -> list[str]:
    """Problems on which something better than the best known was found, by more than `slack`.

    Holes that are known are no news; see `in_holes`.
    """
    lowest: dict[str, float] = {}
    for r in campaign:
        if r.gaps is not None:
            gap = min(*r.gaps, *(r.visited or r.gaps))
            if _in_hole(r.cell.problem, gap):
                continue
            lowest[r.cell.problem] = min(gap, lowest.get(r.cell.problem, gap))
    return [
        f"{problem_name(campaign, p)}: {-gap:.2g} below the best known value, which is not the "
        "optimum then; such gaps count as the floor"
        for p, gap in sorted(lowest.items())
        if gap < -slack
    ]


def in_holes(campaign: Campaign) -> list[str]:
    """Who ended in a hole of a cost, where nobody would want to be, and how often."""
    found = []
    for regime in campaign.regimes:
        for problem in campaign.problems(regime, cost=True):
            who = [
                f"{a} in {len(seeds)} of {len(campaign.runs(regime, problem, a))} seeds"
                for a in campaign.agents
                if (seeds := hole_seeds(campaign, regime, problem, a))
            ]
            if who:
                found.append(
                    f"{problem}, {regime_name(regime, campaign.regimes)}: found the hole of the "
                    f"cost, up to {short(HOLES[problem])} below the basin that gaps are measured "
                    f"from: {', '.join(who)}; such gaps count as the floor"
                )
    return found


def hole_seeds(
    campaign: Campaign, regime: Regime, problem: str, agent: str
) -> tuple[int, ...] | None:
    """Seeds whose returned θ lies in the hole of the cost; None where no hole is known."""
    if problem not in HOLES:
        return None
    runs = campaign.runs(regime, problem, agent)
    return tuple(seed for seed, r in runs.items() if _in_hole(problem, float(curve(r)[-1])))


def _in_hole(problem: str, gap: float) -> bool:
    return problem in HOLES and -HOLES[problem] - HOLE_SLACK <= gap < -HOLE_SLACK


def _tried(campaign: Campaign) -> Iterator[tuple[Regime, str, dict[str, set[int]]]]:
    """The seeds of every agent of the campaign, for each regime and problem."""
    for regime in campaign.regimes:
        for problem in campaign.problems(regime):
            yield (
                regime,
                problem,
                {
                    agent: {
                        *campaign.runs(regime, problem, agent),
                        *campaign.failures(regime, problem, agent),
                    }
                    for agent in campaign.agents
                },
            )
