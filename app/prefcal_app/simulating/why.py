"""Say in one sentence why an experiment is shown, what the answer can change, and what was wanted."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from math import inf

from prefcal_agents.screening.reason import Reason, RobustResult
from prefcal_agents.screening.simulations import ENOUGH
from prefcal_agents.utility.influence import Influence
from prefcal_agents.utility.smaller_change import SmallerChange
from prefcal_env.experiments.experiment import Experiment
from prefcal_scenarios.scenario import KPI, Scenario

_MOST = 2
"""Number of KPIs named on either side of the sentence, those that matter most."""
_LEAST = 0.01
"""Share of a KPI from which on it is a price."""
_HARDLY = 0.05
"""Chance of another result below which it is stated: larger ones are too high (docs/research/result.md)."""


def percent(chance: float) -> str:
    """Return a probability as text: nothing that a model says is sure."""
    if chance < 0.01:
        return "below 1 %"
    if chance > 0.99:
        return "above 99 %"
    return f"{100 * chance:.0f} %"


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
    told = f"{told} It misses the {which} for {_listed(missed)}." if missed else told
    return told if reason.kept is None else f"{told} {_held(reason.kept, 'It')}"


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


def at_stake(chance: float) -> str:
    """Return that the answer to the open question hardly changes the result; empty if it may."""
    return "" if chance >= _HARDLY else f"Your answer hardly changes the result (chance: {percent(chance)})."


def carried_by(influence: Influence | None) -> str:
    """Return which answer carries the result, as one sentence."""
    if influence is None:
        return "No single answer that is in doubt would surely change the result."
    return (
        f"The result rests on the answer about experiment {influence.answer + 1}: if it were the "
        f"other way round, experiment {influence.reversed + 1} would be the best."
    )


def kept(smaller: SmallerChange | None, scenario: Scenario) -> str:
    """Return which knobs can stay as they were, as one sentence; empty if none can."""
    if smaller is None:
        return ""
    names = [scenario.space.names[knob] for knob in smaller.kept]
    return (
        f"{len(names)} of {len(scenario.space)} knobs can stay as before ({_listed(names)}) without "
        f"looking noticeably worse (chance that it does: {percent(smaller.chance)})."
    )


def _held(kept: int, which: str) -> str:
    """Return in one sentence how many perturbed runs keep the limits before one does not."""
    if kept >= ENOUGH:
        return f"{which} keeps the limits in all {ENOUGH} perturbed runs."
    return f"{which} does not hold: perturbed run {kept + 1} of {ENOUGH} does not keep the limits."


def robust(found: RobustResult, scenario: Scenario) -> Iterator[str]:
    """Yield how the result holds and what that costs, a sentence each."""
    yield _held(found.kept, "The result")
    kpis, parts = {kpi.name: kpi for kpi in scenario.kpis}, list[str]()
    for name, (ours, theirs) in found.costs.items():
        share = (ours - theirs) / abs(theirs) if theirs else inf
        if _LEAST <= share < inf:
            title = kpis[name].title if name in kpis else name.replace("_", " ")
            parts.append(f"about {100 * share:.0f} % of {title}")
    if parts:
        yield f"Robustness costs {_listed(parts[:_MOST])}: what promises most nominally does not hold."
    else:
        yield "Robustness costs nothing noticeable."


def menu_names(menu: Mapping[int, Sequence[str]], scenario: Scenario) -> dict[int, str]:
    """Return the name of each candidate on the menu, by the KPI that it gains, none twice if possible.

    Args:
        menu: Rows of the bank, with the KPIs in which each is better than the result.
        scenario: Scenario that has the titles of the KPIs.
    """
    named, found = _namer(scenario), dict[int, str]()
    for row, gained in menu.items():
        names = [named(name, True) for name in gained] or ["another"]
        found[row] = next((name for name in names if name not in found.values()), names[0])
    return found


def wanted(wishes: Mapping[str, float], scenario: Scenario) -> str:
    """Return what the answers fit, with its certainty, as one sentence; empty if nothing is sure."""
    named = _namer(scenario)
    words = _listed([f"{named(name, True)} ({percent(certainty)})" for name, certainty in wishes.items()])
    return f"The answers fit these wishes: {words}." if words else ""
