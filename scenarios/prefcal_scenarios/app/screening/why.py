"""Say in one sentence why a screening agent shows an experiment."""

from collections.abc import Callable, Sequence

import numpy as np

from prefcal_agents.screening.reason import Reason
from prefcal_agents.utility.bank import Bank
from prefcal_scenarios.scenario import Scenario

from .prospect import percent

_MOST = 2
"""Number of KPIs named on either side of the sentence, those that matter most."""
_GOOD = 0.25
"""Share of the simulated θ that an experiment which is good on average belongs to."""


def why(
    reason: Reason,
    scenario: Scenario,
    *,
    side: str = "This one",
    requested: bool = False,
    good: bool = False,
) -> str:
    """Return why an experiment is compared with the best so far, as one sentence.

    Args:
        reason: Reason of the agent.
        scenario: Scenario that has the titles of the KPIs.
        side: Name of the experiment at the start of the sentence, such as "Left".
        requested: Whether the person asked for it.
        good: Whether it is among the best simulated ones by all KPIs alike, see `good_on_average`.
    """
    named = _namer(scenario)
    differs = _differs(reason, named)
    chance = f"(chance that you prefer it: {percent(reason.chance)})"
    if requested:
        return f"{side} is shown because you asked for it: {differs} {chance}."
    if not reason.learned:
        what = "is good in all KPIs on average" if good else "shows what matters to you"
        return f"Nothing learned yet: {side.lower()} {what}; {differs}."
    wanted = [name for name in reason.better_in if name in reason.learned][:_MOST]
    if wanted:
        preferred = _listed([named(name, True) for name in wanted])
        differs = _differs(reason, named, ("it has that", "it has both")[len(wanted) - 1])
        return f"{side} is shown because you preferred {preferred}: {differs} {chance}."
    preferred = named(reason.learned[0], True)
    return f"{side} shows how much {preferred} matters to you: {differs} {chance}."


def _differs(reason: Reason, named: Callable[[str, bool], str], better: str = "") -> str:
    """Return in what it differs from the best so far, the KPIs that matter most.

    Args:
        reason: Reason of the agent.
        named: Function that names a KPI with its direction.
        better: What is better, if that was said before; it is named if empty.
    """
    if reason.better_in and not better:
        better = f"it has {_listed([named(name, True) for name in reason.better_in[:_MOST]])}"
    worse = _listed([named(name, False) for name in reason.worse_in[:_MOST]])
    if better:
        return f"{better}, but {worse}" if worse else better
    return f"it has {worse}" if worse else "its KPIs are about those of the best so far"


def _listed(words: Sequence[str]) -> str:
    return " and ".join(words)


def _namer(scenario: Scenario) -> Callable[[str, bool], str]:
    """Return a function that names a KPI with its direction: better (True) or worse."""
    kpis = {kpi.name: kpi for kpi in scenario.kpis}

    def named(name: str, better: bool) -> str:
        kpi = kpis.get(name)
        if kpi is None:
            return f"{'lower' if better else 'higher'} {name.replace('_', ' ')}"
        if kpi.goal == "target":
            return f"{kpi.title} {'nearer to' if better else 'farther from'} its target"
        rises = better == (kpi.goal == "higher")
        return f"{'higher' if rises else 'lower'} {kpi.title}"

    return named


def good_on_average(bank: Bank, row: int) -> bool:
    """Return whether row `row` is among the best quarter by its mean rank over all KPIs."""
    better = [np.searchsorted(np.sort(column), column) for column in bank.kpis.T]
    ranks = np.mean(better, axis=0)
    return bool(np.mean(ranks < ranks[row]) < _GOOD)
