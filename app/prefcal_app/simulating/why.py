"""What simulations say of a question and of a result."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf

import numpy as np
from jaxtyping import Float

from prefcal_agents.people import Bank
from prefcal_agents.result import Influence, SmallerChange
from prefcal_agents.screening.agent import MOST, Certificate, Reason, RobustResult
from prefcal_agents.screening.bank import ENOUGH
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.knobs import KnobSpace
from prefcal_scenarios.scenario import Scenario

from .simulator import Basis, Carried

# --- Say in one sentence why an experiment is shown, what the answer can change, and what was wanted.

_MOST = 2  # number of KPIs named on either side of the sentence, those that matter most
_LEAST = 0.01  # share of a KPI from which on it is a price
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
    if not gains:  # the scenario states no KPI with a direction
        return reason
    named = (*reason.better_in, *reason.worse_in)
    clear = [name for name in named if gains.get(name)] or [n for n in gains if gains[n]]
    better, worse = ([n for n in clear if gains[n] == sign] for sign in (1, -1))
    return replace(reason, better_in=tuple(better), worse_in=tuple(worse))


def _gains(scenario: Scenario, new: Experiment, best: Experiment) -> Iterator[tuple[str, int]]:
    """Yield each KPI with 1 if `new` reads better, -1 if it reads worse, else 0."""
    for kpi in (*scenario.shown_kpis, *(kpi for kpi in scenario.kpis if kpi.of)):
        of = kpi.of or kpi.name
        if kpi.goal is not None and of in new.kpis and of in best.kpis:
            ours, theirs = (kpi.judged(float(e.kpis[of])) for e in (new, best))
            # Of an unknown direction it is only said which of the two is higher.
            yield kpi.name, (ours < theirs) - (ours > theirs and not kpi.of)


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
    if found.kept < ENOUGH:
        return  # nothing was paid
    yield "They vary the plant and the noise; prefcal verify (V) varies sensors, actuators and task, too."
    kpis, parts = {kpi.name: kpi for kpi in scenario.kpis}, list[str]()
    for name, (ours, theirs) in found.costs.items():
        share = (ours - theirs) / abs(theirs) if theirs else inf if ours > theirs else 0.0
        if share >= _LEAST:
            title = kpis[name].title if name in kpis else name.replace("_", " ")
            # Of 0, or to never, there is no share.
            parts.append(f"about {100 * share:.0f} % of {title}" if share < inf else title)
    costs = _listed(parts[:_MOST]) or f"less than {percent(_LEAST)} of each KPI"
    if found.costs:
        yield f"Robustness costs {costs}: what promises most nominally does not hold."
    else:
        yield "Robustness costs nothing: no simulated θ that does not hold promises more."


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


# --- Read what a question was chosen from, for people, and when to offer to stop.

_UNLIKELY, _KNOWN = 0.1, 0.5
"""Chance below which stopping is offered, and that above which something better is known."""


@dataclass(frozen=True, slots=True)
class Prospect:
    """What the simulated θ are expected to gain.

    Args:
        simulated: Number of simulated θ.
        chance: Probability that the person prefers the most promising one to the best so far, by
            the draws alone.
        certificate: What can be said so that it holds for people unlike the draws; None while
            nothing can.
    """

    simulated: int
    chance: float
    certificate: Certificate | None = None

    @property
    def text(self) -> str:
        """Return whether something better can be expected."""
        said = self.certificate
        if said is not None and not said.explained:
            return "The answers may follow from more than the KPIs: how much is left to gain is not said."
        if said is not None and said.share is not None and said.chance is not None:
            left = (
                f"Of θ drawn at random instead, fewer than {percent(said.share)} are noticeably better (with "
                f"{percent(said.probability)} probability).{_as_good_as(said)}"
            )
            return (
                f"The chance that the most promising of the {self.simulated} simulated is noticeably better "
                f"than the best so far is {percent(said.chance)}. "
                f"{left if said.share < 1 else 'It is too early to say how many of θ drawn at random are.'}"
            )
        return (
            f"The chance that the most promising of the {self.simulated} simulated is better than "
            f"the best so far is {percent(self.chance)}."
        )

    @property
    def offer(self) -> str:
        """Return the offer to stop; empty if there is a reason to continue."""
        chance = self.chance if self.certificate is None else self.certificate.chance
        return f"{self.text} Stop here, or go on?" if chance is not None and chance < _UNLIKELY else ""


def _as_good_as(said: Certificate) -> str:
    """Return how many random experiments the result is equal to, as a sentence after another one.

    Empty if something better is known: then it would read as a contradiction.
    """
    if said.experiments is None or said.chance is None or said.chance > _KNOWN:
        return ""
    low, middle, high = (
        f"{float(f'{n:.2g}'):,.0f}" if n < MOST else f"more than {MOST:,}" for n in said.experiments
    )
    about = middle if middle.startswith("more") else f"about {middle}"
    return f" The best so far is as good as the best of {about} random experiments (90 %: {low} to {high})."


@dataclass(frozen=True, eq=False, slots=True)
class Screened:
    """What a screening agent knows after a record.

    Args:
        space: Knobs of the study.
        basis: What the open question was chosen from, or what is known after the last one.
    """

    space: KnobSpace
    basis: Basis

    @property
    def bank(self) -> Bank:
        """Return the simulated θ with their KPIs."""
        return self.basis.bank

    @property
    def reason(self) -> Reason | None:
        """Return why the challenger of the open question is shown; None without a comparison."""
        return self.basis.reason

    @property
    def prospect(self) -> Prospect | None:
        """Return what the simulated θ still promise; None before an answer that teaches."""
        if not self.basis.past.lessons():
            return None
        return Prospect(len(self.bank), self.basis.chance_of_better, self.basis.certificate)

    @property
    def told_result(self) -> bool:
        """Return whether it is worked out what carries the result of a study that is over."""
        carried = self.basis.carried
        return carried is not None and carried.over and carried.complete

    @property
    def carried(self) -> Carried | None:
        """Return what carries the result; None while not known, and if the KPIs do not explain answers."""
        certificate = self.basis.certificate
        return self.basis.carried if certificate is None or certificate.explained else None

    def result(self, scenario: Scenario) -> tuple[str, ...]:
        """Return how the result holds, what was wanted, what it rests on, and what need not change.

        Empty while not known.
        """
        found, carried = self.basis.carried, self.carried
        if found is None or not found.over:
            return ()
        told = () if found.robustness is None else tuple(robust(found.robustness, scenario))
        if carried is not None:
            told += wanted(carried.wishes, scenario), carried_by(carried.decisive)
            told += (kept(carried.smaller, scenario),)
        return tuple(filter(None, told))

    def row(self, theta: Float[np.ndarray, " n"]) -> int | None:
        """Return the row of the bank that a person cannot tell from θ, shape (n,); None if none.

        An equal one comes first: many θ are not rounded to the same last digits as a single one.
        """
        equal = np.all(self.bank.thetas == theta, axis=1)
        same = equal if equal.any() else self.space.close(theta, self.bank.thetas)
        return int(np.argmax(same)) if same.any() else None
