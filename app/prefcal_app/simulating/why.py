"""Put into words what is found of a question and of a result."""

import re
import shlex
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from math import isinf

import numpy as np
from jaxtyping import Float

from prefcal_agents.learned_cost import LearnedCost
from prefcal_agents.result import Influence, SmallerChange
from prefcal_agents.screening.agent import MOST, Certificate
from prefcal_agents.screening.bank import ENOUGH
from prefcal_agents.screening.findings import Alternative, Findings, Reason, RobustResult, Winner
from prefcal_app.summary import Spread, compare
from prefcal_env.envs.varied_loop import sample_of
from prefcal_env.errors import ScenarioError
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.sources.source import env_of, plant_of
from prefcal_env.sources.varied import BEYOND
from prefcal_scenarios.scenario import KPI, Scenario
from prefcal_scenarios.verification.result import breakable
from prefcal_scenarios.verification.varied_runs import robustly
from prefcal_scenarios.wording import join_words, limits_text, quantity, typed_theta, with_unit

# --- Say in one sentence why an experiment is shown, what the answer can change, and what was wanted.

_MOST = 2  # number of KPIs named on either side of the sentence at most, those that matter most
_NAMED = 3  # number of KPIs named of what could have been the result
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

    KPIs that read the same on both sides are left out, and those whose difference hardly anybody sees: it
    is below what people notice, or the noise, or one sample. What only one side's objective rejects is seen.
    If the agent names no others, those that differ are named in the order of the scenario.
    """
    gains = dict(_gains(scenario, new, best, reason.noticed))
    if not gains:  # the scenario states no KPI with a direction
        return reason
    named = (*reason.better_in, *reason.worse_in)
    clear = [name for name in named if gains.get(name)] or [n for n in gains if gains[n]]
    better, worse = ([n for n in clear if gains[n] == sign] for sign in (1, -1))
    return replace(reason, better_in=tuple(better), worse_in=tuple(worse))


def _gains(
    scenario: Scenario, new: Experiment, best: Experiment, noticed: Mapping[str, float]
) -> Iterator[tuple[str, int]]:
    """Yield each KPI with 1 if `new` reads better, -1 if it reads worse, else 0."""
    hidden = _hidden_in_kpis(scenario, best)
    for kpi in (*scenario.shown_kpis, *(kpi for kpi in scenario.kpis if kpi.of)):
        of = kpi.of or kpi.name
        if kpi.goal is not None and of in new.kpis and of in best.kpis:
            values = [float(e.kpis[of]) for e in (new, best)]
            ours, theirs = map(kpi.judged, values)
            alike = 0 < abs(ours - theirs) < max(hidden.get(of, 0.0), noticed.get(of, 0.0))
            if alike and len({*map(kpi.met, values)}) == 1:
                ours = theirs
            # Of an unknown direction it is only said which of the two is higher.
            yield kpi.name, (ours < theirs) - (ours > theirs and not kpi.of)


def _hidden_in_kpis(scenario: Scenario, run: Experiment) -> dict[str, float]:
    """Return the noise of outputs in the units of those KPIs that are read off one: overshoots and errors.

    It is that of the task or, of an identified plant, of its record: a standard deviation. What hides a
    difference of times is the distance of samples.
    """
    noise, time = _noise(scenario, len(run.channels.y)), run.channels.time_unit
    found, inputs = dict[str, float](), {channel.unit for channel in run.channels.u}
    sample = 1.001 * float(np.median(np.diff(run.t))) if len(run.t) > 1 else 0.0  # one sample is not seen
    for kpi in scenario.kpis:
        if time and kpi.unit == time:
            found[kpi.name] = sample
        for i, y in enumerate(run.channels.y):
            of = re.search(rf"(?<!\w){re.escape(y.name)}(?!\w)", kpi.title) is not None
            named = of or (len(noise) == 1 and kpi.unit not in inputs)
            if kpi.unit == "%" and of and kpi.title.startswith("overshoot"):
                values = run.output(i)
                away = () if values is None or not len(values) else np.abs(run.reference(i) - values[0])
                step = float(np.max(away, initial=0.0))
                found[kpi.name] = 100 * float(noise[i] / step) if step > 0 else 0.0
            elif named and kpi.unit == y.unit:
                found[kpi.name] = float(noise[i])
    return found


def _noise(scenario: Scenario, count: int) -> Float[np.ndarray, " n_y"]:
    """Return the standard deviation of the noise of each of `count` outputs; 0 where none is known."""
    known = getattr(getattr(env_of(scenario.source), "task", None), "noise", None)
    plant = plant_of(scenario.source) if known is None else None
    if plant is not None and (sample := sample_of(plant)):
        known = [sample.noise]
    return np.zeros(count) if known is None or len(known) != count else np.asarray(known, dtype=float)


def why(
    reason: Reason,
    scenario: Scenario,
    *,
    side: str = "This one",
    requested: bool = False,
    learned: bool = True,
    missed: Sequence[str] = (),
    shown: Experiment | None = None,
    best: Experiment | None = None,
) -> str:
    """Return why an experiment is compared with the best so far, as one sentence.

    Args:
        reason: Reason of the agent, see `as_shown`.
        scenario: Scenario that has the titles of the KPIs.
        side: Name of the experiment at the start of the sentence, such as "Left".
        requested: Whether the person asked for it.
        learned: Whether there is an answer that a chance follows from.
        missed: Titles of the KPIs whose objectives the new experiment misses and the best meets.
        shown: The experiment, if it ran on the plant that perturbed runs vary.
        best: The best so far, likewise.
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
    told = f"{told} It misses the {which} for {join_words(missed)}." if missed else told
    if reason.kept is None:
        return told
    held = [_held(reason.kept, "It", scenario, shown)]
    if reason.against is not None:
        held.append(_held(reason.against, "The best so far", scenario, best))
    return " ".join([told, *held])


def _differs(reason: Reason, named: Callable[[str, bool], str]) -> str:
    """Return in what it differs from the best so far, the KPIs that matter most."""
    better = " and ".join([named(name, True) for name in reason.better_in[:_MOST]])
    worse = " and ".join([named(name, False) for name in reason.worse_in[:_MOST]])
    if better and worse:
        return f"has {better}, but {worse}"
    return f"has {better or worse}" if better or worse else "has about the KPIs of the best so far"


def named_titles(reason: Reason, scenario: Scenario) -> list[str]:
    """Return the titles under which people see the KPIs that the sentence of `why` names, in its order."""
    kpis = {kpi.name: kpi for kpi in scenario.kpis}
    named = (*reason.better_in[:_MOST], *reason.worse_in[:_MOST])
    shown = [kpis.get(kpis[name].of or name) for name in named if name in kpis]
    return [kpi.title for kpi in shown if kpi is not None]


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


def rival(found: Findings, scenario: Scenario, run: Callable[[int], Experiment]) -> str:
    """Return the KPIs of what another answer would make the best, that differ most, as a sentence.

    It is empty if no answer would, or they read the same. `run` returns an experiment by its index.
    """
    other = found.decisive
    if other is None or found.best is None:
        return ""
    rows = compare(run(found.best), run(other.reversed), scenario.shown_kpis, Spread())
    pairs = [
        f"{row['title']} {with_unit(row['right']['text'], row['unit'])} "
        f"(result: {with_unit(row['left']['text'], row['unit'])})"
        for row in rows
        if row["size"]
    ]
    return f"Experiment {other.reversed + 1} has {join_words(pairs[:_NAMED])}." if pairs else ""


def kept(smaller: SmallerChange | None, scenario: Scenario) -> str:
    """Return which knobs can stay as they were, as one sentence; empty if none can."""
    if smaller is None:
        return ""
    names = [scenario.space.names[knob] for knob in smaller.kept]
    return (
        f"{len(names)} of {len(scenario.space)} knobs can stay as before ({join_words(names)}) without "
        f"looking noticeably worse (chance that it does: {percent(smaller.chance)})."
    )


_UNLIMITED = " (not sensors, actuators or task)"
"""What does not vary beside each count of runs where no limit is stated: `prefcal verify` may count fewer."""


def _runs(scenario: Scenario) -> str:
    """Return what is counted of a robust study."""
    return f"runs with varied plants{'' if breakable(scenario.kpis) else _UNLIMITED}"


def _held(
    kept: int, which: str, scenario: Scenario, nominal: Experiment | None, *, outdone: bool = False
) -> str:
    """Return how many perturbed runs keep the limits that the nominal one meets.

    Where there is none, it says what was asked instead, as `prefcal verify` does. If the nominal run is
    not known, it names no limit. What is `outdone` does not hold, see `RobustResult`.
    """
    limited, runs = breakable(scenario.kpis), _runs(scenario)
    met, missed = (
        [k.title for k in limited if nominal is not None and k.met_by(nominal) is one]
        for one in (True, False)
    )
    left = f" It misses {join_words(missed)} even nominally." if missed else ""
    if outdone and kept >= ENOUGH:
        stated = [k for k in scenario.kpis if k.met(0.0) is not None]
        failed = [k.title for k in stated if nominal is not None and k.met_by(nominal) is False]
        lost = join_words(failed or ["a stated limit"])
        keeps = f" It keeps {join_words(met)} in all {ENOUGH} {runs}." if met else ""
        first = f"{which} does not hold: it misses {lost} nominally"
        return f"{first}, and a simulated θ misses fewer limits.{keeps}"
    if limited and (met or nominal is None):
        named = f"the limit{'s' * (len(met) > 1)} on {join_words(met)}"
        those = named if met else "all limits that it meets nominally"
        if kept >= ENOUGH:
            first = f"does not hold: it misses {join_words(missed)} already nominally. It " if missed else ""
            return f"{which} {first}keeps {those} in all {ENOUGH} {runs}."
        keeps = f"keep {those}"
    else:
        none = "it meets no stated limit nominally" if limited else "no limit is stated"
        reach = "safely and reach what the nominal run reaches"
        if kept >= ENOUGH and limited:
            ends = f"All {ENOUGH} {runs} end {reach}, no more."
            return f"{which} does not hold: it meets no stated limit.{left} {ends}"
        if kept >= ENOUGH:
            return f"{which} holds: all {ENOUGH} {runs} end {reach} ({none})."
        keeps = f"end {reach} ({none})"
    return f"{which} does not hold in {ENOUGH - kept} of {ENOUGH} {runs}: {kept} {keeps}.{left}"


def _perturbed(scenario: Scenario) -> str:
    """Return what perturbed runs vary, and what `prefcal verify` varies beside, in the words of its table."""
    try:
        factors = scenario.source.elsewhere.here.varied().factors
    except ScenarioError:  # its files may have changed since
        more = join_words(list(BEYOND.values()))
        plant = (
            f"The varied runs vary the plant and the seed of its noise; prefcal verify varies {more}, too."
        )
        return "The varied runs vary what prefcal verify varies." if breakable(scenario.kpis) else plant
    own, others = ([f.name for f in each] for each in robustly(factors, scenario.kpis))
    if breakable(scenario.kpis):
        but = f", without {' and '.join(others)}" if others else ""
        return f"The varied runs are other draws of what prefcal verify varies{but}."
    and_more = f"; prefcal verify also varies {join_words(others)}" if others else ""
    return f"The varied runs vary {join_words([*own, 'the seed of the noise'])}{and_more}."


def robust(found: RobustResult, scenario: Scenario, nominal: Experiment | None = None) -> Iterator[str]:
    """Yield how the result, whose nominal run may be known, holds and what that costs, a sentence each."""
    yield _held(found.kept, "The result", scenario, nominal, outdone=found.outdone)
    if found.won is not None:
        yield _tell_winner(found.won, found, scenario)
    if found.kept == ENOUGH:
        yield _perturbed(scenario)
    else:
        none = "None of the simulated θ was found to hold in more of the same runs, beyond chance."
        yield _more_often(found, scenario) if found.most else none
    missed = nominal is not None and any(k.met_by(nominal) is False for k in scenario.kpis)
    if found.outdone or missed or found.most or found.winner_has_price:
        return  # what misses limits as modeled has no price, nor what another does better; one is enough
    limited = found.among and any(k.met(0.0) is not None for k in scenario.kpis)
    if found.costs and (found.kept == ENOUGH or found.others_kept is not None):
        those = ", of what keeps the stated limits," if limited else ""
        which = f" ({typed_theta(scenario.space, found.other)})" if found.other else ""
        costs, fails = _sum_up(found.costs, scenario), _fails(found, scenario)
        yield f"Robustness costs {costs}: what promises most nominally{those} does not hold{which}{fails}."
    elif found.kept == ENOUGH:
        those = "keeps the stated limits nominally but does" if limited else "does"
        yield f"Robustness costs nothing: no simulated θ that {those} not hold promises more."


def _sum_up(costs: Sequence[tuple[str, float, float]], scenario: Scenario) -> str:
    """Return by how much the result is worse than another θ in the KPIs that matter most."""
    kpis = {kpi.name: kpi for kpi in scenario.kpis}
    prices = [_price(kpis.get(name), name, ours, theirs) for name, ours, theirs in costs]
    hardly = f"less than {percent(_LEAST)} of each KPI"
    return join_words([price for price in prices if price][:_MOST]) or hardly


def _tell_winner(won: Winner, found: RobustResult, scenario: Scenario) -> str:
    """Return what won by the answers, in how many runs it holds, and what the result costs in its place."""
    count = f"holds in {won.kept} of the same {ENOUGH} runs"
    but = "misses other stated limits as modeled" if won.kept is None else count
    costs = [f"costs {_sum_up(won.costs, scenario)}"] if won.costs else []
    several, numbers = len(won.overruled) > 1, join_words([str(k + 1) for k in won.overruled])
    if won.overruled:
        costs.append(f"overrules the answer{'s' * several} about experiment{'s' * several} {numbers}")
    instead = f" The result in its place {join_words(costs)}." if costs else ""
    return f"Experiment {won.index + 1} won by the answers, but {but}.{instead}"


def _fails(found: RobustResult, scenario: Scenario) -> str:
    """Return in how many runs what robustness is measured beside fails, and by what; "" if not known."""
    if found.others_kept is None:
        return ""
    kpis, said = {kpi.name: kpi for kpi in scenario.kpis}, list[str]()
    for name, count in found.losses[:_NAMED]:
        limit = limits_text(kpis[name]) if name in kpis else ""
        title = kpis[name].title if name in kpis else name.replace("_", " ")
        lost = f"{title} {limit} missed" if limit else f"{title} infinite" if name else "no finite KPI"
        said.append(f"{lost} in {count}")
    by = f" ({'; '.join(said)})" if said else ""
    failed = ENOUGH - found.others_kept
    return f": {failed} of the same {ENOUGH} runs fail{'s' * (failed == 1)}{by}"


def _more_often(found: RobustResult, scenario: Scenario) -> str:
    """Return which simulated θ holds in more runs, what else it changes as modeled, and how to compare it."""
    kpis = {kpi.name: kpi for kpi in scenario.kpis}
    read = [_read(kpis.get(name), name, *pair) for name, *pair in found.costs[:_NAMED]]
    changes = [f"{title} {theirs} (result: {ours})" for title, ours, theirs in read if ours != theirs]
    has = f"; as modeled it has {join_words(changes)}" if changes else ""
    said = f"Another simulated θ holds in {found.most} of the same runs{has}."
    if not found.other:
        return said
    start = shlex.join(["--start", typed_theta(scenario.space, found.other)])
    return f"{said} A study with {start} compares it."


def _price(kpi: KPI | None, name: str, ours: float, theirs: float) -> str:
    """Return by how much the value of a KPI is worse than another, both as agents know them; "" if hardly."""
    title, *read = _read(kpi, name, ours, theirs)
    if kpi and kpi.goal == "target" and not theirs:
        return f"{title} ({read[0]} from the middle of its objective, within it otherwise)"
    said = f"{title} ({read[0]} instead of {read[1]})"
    if not theirs or isinf(ours):  # there is no share of 0, and none by which never is later than something
        return said
    share = (ours - theirs) / abs(theirs)
    return f"about {100 * share:.0f} % of {said}" if share >= _LEAST else ""


def _read(kpi: KPI | None, name: str, *values: float) -> tuple[str, ...]:
    """Return the title of a KPI and, as people read them, values as agents know them."""
    title, unit = (kpi.title, kpi.unit) if kpi else (name.replace("_", " "), "")
    sign = -1.0 if kpi and kpi.goal == "higher" else 1.0
    return title, *("never" if isinf(v) else quantity(sign * v + 0.0, unit) for v in values)


def menu_names(
    menu: Sequence[Alternative],
    kpis: Sequence[Mapping[str, float]],
    result: Mapping[str, float],
    scenario: Scenario,
) -> list[str]:
    """Return the name of each θ on the menu: the KPI that it gains, and what that costs most.

    It is empty for one that reads better than the result in no KPI, or that has the name of another one.

    Args:
        menu: θ that the person might prefer to the result.
        kpis: KPIs of each as people read them, by name, lower is better.
        scenario: Scenario that has the titles of the KPIs.
    """
    named, found = _namer(scenario), list[str]()
    both_ways = {kpi.name for kpi in scenario.kpis if kpi.of}  # what is higher is no price there
    for other, own in zip(menu, kpis, strict=True):
        gains = dict.fromkeys(n for n in (*other.better_in, *own) if own[n] < result[n])
        prices = [n for n in own if own[n] > result[n] and n not in both_ways]
        price = max(prices, key=lambda n: _dearer(own[n], result[n]), default="")
        but = f", but {named(price, False)}" if price else ""
        names = [f"{named(name, True)}{but}" for name in gains]
        found.append(next((name for name in names if name not in found), ""))
    return found


def _dearer(ours: float, theirs: float) -> float:
    """Return how much more one value is than another, as a share of the larger one."""
    return 1.0 if isinf(ours) else (ours - theirs) / max(abs(ours), abs(theirs))


def name_wishes(found: Findings, scenario: Scenario, index: LearnedCost | None) -> str:
    """Return what the answers fit, with its certainty, as one sentence; empty if nothing is sure.

    A certainty is that of people who go by KPIs, so it is only said if answers are predicted from them:
    `index` is the sum of KPIs whose predictions stand beside it, None if there is none.
    """
    named, kpis = _namer(scenario), {kpi.name: kpi for kpi in scenario.kpis}
    words = [f"{named(name, True)} ({percent(certainty)})" for name, certainty in found.wishes]
    words += [
        f"{kpis[name].title} {limits_text(kpis[name])} ({percent(certainty)})"
        for name, certainty in found.bounds
        if name in kpis
    ]
    if words and index is None:
        return "The answers are too few to say which KPIs decided them."
    if words and index is not None and not index.explains:
        return (
            "Which KPIs decided the answers is not said: of the "
            f"{index.answers} that prefer a side, {index.predicted} could be predicted from the KPIs and the "
            "other answers, and guessing may do as well."
        )
    return f"The answers fit these wishes: {join_words(words)}." if words else ""


def robust_study(
    found: Findings | None,
    scenario: Scenario,
    nominal: Experiment | None = None,
    *,
    best: int | None = None,
    counts: Mapping[int, int] | None = None,
) -> tuple[str, ...]:
    """Return how the best of a robust study holds, a sentence each, also if that was left before its end.

    `counts` says how many perturbed runs the two experiments keep that were compared last, by index: all
    that is known if nothing was worked out after that answer, which may have made another one the best.
    """
    if found is not None and found.over and found.robustness is not None:
        return tuple(robust(found.robustness, scenario, nominal))
    last = {} if counts is None or found is not None else counts
    known = next((count for index, count in last.items() if index == best), None)
    kept = known if found is None else found.kept
    if kept is None:
        return (f"Whether the result holds in {ENOUGH} {_runs(scenario)} was not worked out.",)
    more = [
        f"Experiment {index + 1} holds in {count}: the study was left before it chose between them by that."
        for index, count in last.items()
        if count > kept
    ]
    return _held(kept, "The result", scenario, nominal), *more, _perturbed(scenario)


def told(
    found: Findings,
    scenario: Scenario,
    run: Callable[[int], Experiment],
    *,
    index: LearnedCost | None,
    nominal: Experiment | None,
) -> tuple[str, ...]:
    """Return how the result holds, what was wanted, what it rests on, and what need not change.

    Empty while not known. `run` returns an experiment by its index; for the others see `name_wishes` and
    `robust`.
    """
    if not found.concluded:
        return ()
    said = () if found.robustness is None else tuple(robust(found.robustness, scenario, nominal))
    if found.explained:
        said += (
            name_wishes(found, scenario, index),
            carried_by(found.decisive),
            rival(found, scenario, run),
            kept(found.smaller, scenario),
        )
    return tuple(filter(None, said))


# --- Say what the simulated θ still promise, and when to offer to stop.

_EARLY = "The answers are too few to say how many of θ drawn at random are."
UNLIKELY, _KNOWN = 0.1, 0.5
"""Chance below which stopping is offered, and that above which something better is known."""


def promise(found: Findings) -> str:
    """Return whether something better can be expected; empty before an answer that teaches."""
    said, chance = found.certificate, found.chance_of_better
    if chance is None:
        return ""
    if said is not None and not said.explained:
        why = "what was learned from the other answers predicts each one no better than chance"
        if said.by_knobs:
            why = "the values of the knobs predict the answers even better than the KPIs, by which it is told"
        return f"How much is left to gain is not said: {why}."
    # To know which of them hold would take hundreds of runs of each.
    which = f"the {found.simulated} simulated{'' if found.kept is None else ', whether it holds or not,'}"
    if said is not None and said.share is not None and said.chance is not None:
        left = _few_left(found)
        more = f"{left}{_as_good_as(said)}" if left else _EARLY
        return (
            f"The chance that the most promising of {which} is noticeably better than the best so far is "
            f"{percent(said.chance)}. {more}"
        )
    return (
        f"The chance that the most promising of {which} is better than the best so far is {percent(chance)}."
    )


def _few_left(found: Findings) -> str:
    """Return of how many random θ fewer are noticeably better; empty where that is not said."""
    said = found.certificate
    if said is None or said.share is None or said.share >= 1:
        return ""
    drawn = f"drawn at random,{'' if found.kept is None else ' whether they hold or not,'}"
    return (
        f"Of θ {drawn} fewer than {percent(said.share)} are noticeably better (with "
        f"{percent(said.probability)} probability)."
    )


def offer(found: Findings) -> str:
    """Return the offer to stop; empty if there is a reason to continue."""
    # The certificate's chance holds for people unlike the draws, too; `chance_left` is that.
    chance = found.chance_of_better if found.certificate is None else found.certificate.chance
    unlikely = chance is not None and chance < UNLIKELY and found.chance_of_better is not None
    return f"{promise(found)} Stop here, or go on?" if unlikely else ""


def chance_left(found: Findings) -> float | None:
    """Return the chance that something better is left, as `promise` says it; None while that is not said."""
    if found.chance_of_better is None:
        return None
    # The certificate's chance holds for people unlike the draws, too.
    return found.chance_of_better if found.certificate is None else found.certificate.chance


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
    between = "" if low == high else f" (90 %: {low} to {high})"  # they are all that were simulated
    return (
        " That bound is a careful one: it is for the hardest kind of person, too. Over all kinds together, "
        f"the best so far is as good as the best of {about} random experiments{between}."
    )
