"""Say in one sentence why a screening agent shows an experiment."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

from prefcal_agents.screening.reason import Reason
from prefcal_env.experiments.experiment import Experiment
from prefcal_scenarios.scenario import KPI, Scenario

from .screened import percent

_MOST = 2
"""Number of KPIs named on either side of the sentence, those that matter most."""


def as_shown(reason: Reason, scenario: Scenario, new: Experiment, best: Experiment) -> Reason:
    """Return the reason with only what people can read off the two experiments.

    KPIs that read the same on both sides are left out. If the agent names no others, those that
    differ are named in the order of the scenario.
    """
    gains = dict(_gains(scenario, new, best))
    named = (*reason.better_in, *reason.worse_in)
    if not gains:  # the scenario states no KPI with a direction
        return reason
    clear = [name for name in named if gains.get(name)] or [n for n in gains if gains[n]]
    better, worse = ([n for n in clear if gains[n] == sign] for sign in (1, -1))
    return replace(reason, better_in=tuple(better), worse_in=tuple(worse))


def _gains(scenario: Scenario, new: Experiment, best: Experiment) -> Iterator[tuple[str, int]]:
    """Yield each KPI with 1 if `new` reads better, -1 if it reads worse, else 0."""
    for kpi in scenario.shown_kpis:
        if kpi.goal is not None and kpi.name in new.kpis and kpi.name in best.kpis:
            ours, theirs = (kpi.judged(float(e.kpis[kpi.name])) for e in (new, best))
            yield kpi.name, (ours < theirs) - (ours > theirs)


def why(
    reason: Reason,
    scenario: Scenario,
    *,
    side: str = "This one",
    requested: bool = False,
    learned: bool = True,
    missed: Sequence[str] = (),
) -> str:
    """Return why an experiment is compared with the best so far, as one sentence.

    Args:
        reason: Reason of the agent, see `as_shown`.
        scenario: Scenario that has the titles of the KPIs.
        side: Name of the experiment at the start of the sentence, such as "Left".
        requested: Whether the person asked for it.
        learned: Whether there is an answer that a chance follows from.
        missed: Titles of the KPIs whose objectives the new experiment misses and the best meets.
    """
    differs = _differs(reason, _namer(scenario))
    chance = f" (chance that you prefer it: {percent(reason.chance)})" if learned else ""
    if requested:
        told = f"{side} is shown because you asked for it: it {differs}{chance}."
    elif learned:
        told = f"{side} {differs}{chance}."
    else:
        told = f"Nothing learned yet: {side.lower()} {differs}."
    which = "objectives" if len(missed) > 1 else "objective"
    return f"{told} It misses the {which} for {_listed(missed)}." if missed else told


def _differs(reason: Reason, named: Callable[[str, bool], str]) -> str:
    """Return in what it differs from the best so far, the KPIs that matter most."""
    better = _listed([named(name, True) for name in reason.better_in[:_MOST]])
    worse = _listed([named(name, False) for name in reason.worse_in[:_MOST]])
    if better and worse:
        return f"has {better}, but {worse}"
    return f"has {better or worse}" if better or worse else "reads like the best so far in all KPIs"


def _listed(words: Sequence[str]) -> str:
    *most, last = words or ("",)
    return " and ".join([", ".join(most), last] if most else [last])


def _namer(scenario: Scenario) -> Callable[[str, bool], str]:
    """Return a function that names a KPI with its direction: better (True) or worse."""
    kpis: dict[str, KPI] = {kpi.name: kpi for kpi in scenario.kpis}

    def named(name: str, better: bool) -> str:
        kpi = kpis.get(name)
        if kpi is None:
            return f"{'lower' if better else 'higher'} {name.replace('_', ' ')}"
        if kpi.goal == "target":
            return f"{kpi.title} {'nearer to' if better else 'farther from'} its target"
        rises = better == (kpi.goal == "higher")
        return f"{'higher' if rises else 'lower'} {kpi.title}"

    return named
