"""All that is said of the result of a study or of its open question, as one value."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_agents.agent import one_thread
from prefcal_agents.people import Bank, notice_chance
from prefcal_agents.result import (
    DrawPool,
    Influence,
    SmallerChange,
    cautious,
    decisive,
    influences,
    noticed_worse,
    others,
    smaller_change,
    stakes,
    wishes,
)
from prefcal_env.arrays import holds_more
from prefcal_env.errors import StudyError
from prefcal_env.plain import from_plain, to_plain
from prefcal_env.preferences.answer import Preference
from prefcal_env.preferences.history import History

from .agent import Certificate, Screening
from .bank import ENOUGH, Stage

# --- Say why an experiment is shown, as data that front ends put into words.

_DIFFERS = 0.02  # share of what all differences count together below which that of a KPI is left out
_NOTHING = 1e-9
_SHARP = 0.1  # share of the drawn people, those who see most, who notice what is called a difference


@dataclass(frozen=True, slots=True)
class Reason:
    """Why the challenger of the open query is shown.

    Args:
        chance: Probability that the person prefers it to the best so far, by what was learned.
        better_in: Names of the KPIs in which it is better than the best so far, the one that
            matters most first.
        worse_in: Names of those in which it is worse, likewise.
        kept: In a robust study, how many of `ENOUGH` perturbed runs keep the limits.
        against: How many of those of the best so far do.
        noticed: Smallest difference of each KPI that a tenth of the people notice, of those whom answers fit.
    """

    chance: float
    better_in: tuple[str, ...]
    worse_in: tuple[str, ...]
    kept: int | None = None
    against: int | None = None
    noticed: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Winner:
    """What won by the answers, where the result of a robust study is another experiment, which holds in more.

    Args:
        index: Number of the experiment, from 0.
        kept: How many of the same perturbed runs it keeps; None if it misses other limits as modeled.
        costs: KPIs in which it is better than the result, as those of `RobustResult`.
        overruled: Numbers, from 0, of the experiments whose answers call another one better than the result.
    """

    index: int
    kept: int | None
    costs: tuple[tuple[str, float, float], ...] = ()
    overruled: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class RobustResult:
    """How the best θ of a robust study holds, and what that costs nominally.

    Args:
        kept: How many of `ENOUGH` perturbed runs keep the limits.
        most: How many another simulated θ keeps, if that is more, beyond chance; else 0.
        costs: KPIs in which another θ is better that promises most, but keeps fewer, or in which the one
            that keeps more runs differs, what matters most first; each with the value of the best θ and of
            that one, as agents know them.
        outdone: Whether it does not hold since it misses more limits nominally than a simulated θ does.
        among: Whether costs are beside those θ alone that keep all stated limits nominally.
        first: How many of the same runs the first experiment keeps; None if it is the best, or misses other
            limits as modeled.
        other: That other θ, physical; empty without one.
        others_kept: How many of the same runs that one keeps; None if that was not asked.
        losses: In how many of them it loses which KPI, by name, the most first; "" is all of them.
        won: What won by the answers, if that is not the best.
    """

    kept: int
    costs: tuple[tuple[str, float, float], ...] = ()
    outdone: bool = False
    among: bool = False
    most: int = 0
    first: int | None = None
    other: tuple[float, ...] = ()
    others_kept: int | None = None
    losses: tuple[tuple[str, int], ...] = ()
    won: Winner | None = None

    @property
    def winner_has_price(self) -> bool:
        """Return whether what won by the answers says what robustness costs."""
        return self.won is not None and self.won.kept is not None


def reason_for(stage: Stage, new: int, best: int, history: History) -> Reason:
    """Return why row `new` of the bank is compared with row `best`."""
    names, utilities = stage.scale.names, stage.utilities
    levels = utilities.levels(stage.logs[[new, best]])
    parts = utilities.gains(levels, np.array([0]), np.array([1]))[:, :, 0]
    shares = parts / (np.abs(parts).sum(axis=0) + _NOTHING)  # in orders one KPI decides
    gains = shares.mean(axis=1).reshape(2, len(names)).sum(axis=0)  # and its limit
    clear = np.abs(gains) > _DIFFERS * np.abs(gains).sum()
    order = [int(kpi) for kpi in np.argsort(-np.abs(gains), kind="stable") if clear[kpi]]
    return Reason(
        float(chances(stage, best, history)[new]),
        tuple(names[kpi] for kpi in order if gains[kpi] > 0),
        tuple(names[kpi] for kpi in order if gains[kpi] < 0),
        noticed=dict(zip(names, np.quantile(utilities.steps, _SHARP, axis=0).tolist(), strict=True)),
    )


def chances(stage: Stage, best: int, history: History) -> Float[np.ndarray, " m"]:
    """Return how probably the person prefers each θ to row `best`, shape (m,).

    Somebody who often sees no difference prefers the new one less often than the costs say, so the
    chance is multiplied by the share of answers so far that prefer a side.
    """
    given = [c.answer.preference is not Preference.TIE for c in history.lessons]
    # As if one more answer had preferred a side: without any, nothing is known against the draws.
    told = (sum(given) + 1) / (len(given) + 1)
    return np.asarray(told * notice_chance(stage.costs[:, best, None] - stage.costs).mean(axis=0))


def trend(z: Float[np.ndarray, "m n"], value: Float[np.ndarray, " m"], row: int) -> Float[np.ndarray, " n"]:
    """Return how the expected worth grows along each knob near one θ, shape (n,).

    It is the slope of a plane through the θ of the bank, of which those near count more.

    Args:
        z: Points of the cube, shape (m, n).
        value: Their expected worth, shape (m,).
        row: Row of the θ.
    """
    steps = z - z[row]
    # Weights of a normal law, whose deviation is a fifth of the cube's diagonal.
    near = np.exp(-0.5 * np.sum(steps**2, axis=1) / (0.2**2 * z.shape[1]))
    plane = np.column_stack([np.ones(len(z)), steps])
    weighted = plane.T * near
    # The ridge decides where all near θ share a value of a knob: there the slope is 0.
    square = weighted @ plane + 1e-6 * np.eye(plane.shape[1])
    return np.asarray(np.linalg.solve(square, weighted @ value)[1:])


# --- Say all that can be said, in parts: what comes with a question, what takes seconds, what is simulated.


@dataclass(frozen=True, slots=True)
class Alternative:
    """A simulated θ that the person might prefer to the result.

    Args:
        theta: θ, physical.
        better_in: Names of the KPIs in which it is better than the result, what matters most first.
    """

    theta: tuple[float, ...]
    better_in: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Findings:
    """All that is said of a result or, while the study goes on, of its open question.

    It is made in parts by `findings`: all from `stakes` on is empty until it is worked out.

    Args:
        over: Whether it is about the result of a study that is over.
        simulated: Number of simulated θ that the question was chosen from, or the result.
        reason: Why the challenger of the open question is shown; None without a comparison.
        chance_of_better: Probability that the person prefers the most promising of the simulated θ that
            were not shown to the best so far, by the draws alone; None before an answer that teaches.
        trend: How expected worth grows along each knob near the best; None before an answer that
            teaches, and among given candidates, whose order means nothing.
        certificate: What can be said of the best so far; None while nothing can.
        kept: In a robust study, how many of `ENOUGH` perturbed runs of the best so far keep the limits.
        stakes: Chance that the answer to the open question changes the best; None without one.
        influences: What the result would be if each answer were the other way round.
        best: Sample that is the result; None before any answer.
        menu: Up to two θ that the person might prefer to the result, as different as they can be. Those that
            never reach what the result reaches are left out, and in a robust study those that do not hold.
        wishes: KPIs that the person surely wanted better, each with how sure that is.
        bounds: KPIs of which that is sure only beyond a stated limit, which the result keeps, likewise.
        robustness: How the result holds, and what that costs; None if the study is not robust.
        smaller: The result with knobs as in the given start, so that people hardly notice; None without
            a start, if no knob can be put back, and where experiments measured other KPIs than those
            simulated.
        parts: Number of parts that are worked out.
        complete: Whether these are all.
    """

    over: bool
    simulated: int
    reason: Reason | None = None
    chance_of_better: float | None = None
    trend: tuple[float, ...] | None = None
    certificate: Certificate | None = None
    kept: int | None = None
    stakes: float | None = None
    influences: tuple[Influence, ...] = ()
    best: int | None = None
    menu: tuple[Alternative, ...] = ()
    wishes: tuple[tuple[str, float], ...] = ()
    bounds: tuple[tuple[str, float], ...] = ()
    robustness: RobustResult | None = None
    smaller: SmallerChange | None = None
    parts: int = 1
    complete: bool = False

    @property
    def explained(self) -> bool:
        """Return whether the KPIs explain the answers: otherwise what follows from them is not said."""
        return self.certificate is None or self.certificate.explained

    @property
    def concluded(self) -> bool:
        """Return whether it is known what carries the result of a study that is over."""
        return self.over and self.parts > 1

    @property
    def decisive(self) -> Influence | None:
        """Return the answer in doubt that carries the result; None if none alone does."""
        found = None if self.best is None else decisive(self.influences, self.best)
        return found if found and found.doubtful else None

    def to_dict(self) -> dict[str, object]:
        """Return it as plain data, which a study file keeps."""
        return {name: to_plain(getattr(self, name)) for name in self.__slots__}

    @classmethod
    def from_dict(cls, data: Mapping[str, object]) -> "Findings":
        """Return what `to_dict` returned as plain data. Raises StudyError if it is something else."""
        return from_plain(data, cls, StudyError, "what was said of the result")


def findings(agent: Screening, known: Findings | None = None, *, over: bool | None = None) -> Findings:
    """Return what is said of the open query or of the result: the first part, or one more than is known.

    It is a function of the agent's settings, seed and record. The first part comes with the query, the
    second one takes seconds at the end. With a given start, the third one simulates smaller changes.

    Args:
        agent: Agent with the record, which simulates if needed.
        known: What was returned before for the same record; None for the first part.
        over: Whether the study is over, as it is if a person ends it; by default, if the agent is done.
    """
    over = agent.done if over is None else over
    parts = [_explain_query, _explain_result]
    if over and agent.setup.start:
        parts.append(_find_smaller_change)
    # A study that ended, or goes on, is told of anew: its parts are about another thing.
    given = 0 if known is None or known.over is not over else known.parts
    if known is not None and given == len(parts):
        return known
    with one_thread():
        found = parts[given](agent, Findings(over, 0) if known is None or not given else known)
    return replace(found, parts=given + 1, complete=given + 1 == len(parts))


def simulated_for(agent: Screening, found: Findings) -> Bank:
    """Return the simulated θ, all that are named in the findings among them."""
    if found.smaller is None:
        return agent.bank
    thetas = np.array([found.smaller.theta])
    return agent.growth.extend(agent.bank, agent.space.encode_all(thetas), thetas)


def _explain_query(agent: Screening, empty: Findings) -> Findings:
    """Return why the challenger is shown, and what better ones can be expected."""
    history, stage = agent.history, agent.stage(agent.history)
    # Who ended the study is asked nothing any more, and nothing is simulated for that.
    asks = not agent.done and (not empty.over or history.pending is not None)
    found = replace(
        empty,
        simulated=len(stage.bank),
        reason=_reason(agent, stage) if asks else None,
        certificate=agent.certificate,
    )
    if agent.best_index is None or not history.lessons:
        return found
    best = stage.bank.find(agent.best)
    likely = chances(stage, best, history)
    # The best of what was shown is the result itself: only what is new can be better.
    likely[stage.bank.rows([s.theta for s in history.samples[: history.answered]])] = 0.0
    along = None
    if agent.simulations.candidates is None:
        along = tuple(trend(stage.bank.z, agent.growth.worth(history.past).mean(axis=0), best).tolist())
    kept = None
    if agent.simulations.holds is not None:
        kept = int(agent.simulations.runs_kept(stage.bank.thetas[best]).sum())
    return replace(found, chance_of_better=float(likely.max()), trend=along, kept=kept)


def _reason(agent: Screening, stage: Stage) -> Reason | None:
    query = agent.ask()
    if query.incumbent is None:
        return None
    samples = [agent.history.samples[each.index] for each in (query.challenger, query.incumbent)]
    both = np.array([sample.theta for sample in samples])
    if not stage.bank.has_all(both):  # a person gave or asked for one
        stage = agent.growth.stage_with(samples, agent.history.past, stage)
    new, best = stage.bank.rows(list(both)).tolist()
    found = reason_for(stage, new, best, agent.history)
    if agent.simulations.holds is None:
        return found
    kept, against = (int(agent.simulations.runs_kept(theta).sum()) for theta in both)
    return replace(found, kept=kept, against=against)


def _explain_result(agent: Screening, known: Findings) -> Findings:
    """Add what the answer to the open query can change or, at the end, what carries the result."""
    past = agent.history.past
    if not known.over:
        return replace(known, stakes=_stakes(agent, past))
    if agent.best_index is None or not past.lessons:
        return known
    stage, pool = agent.stage(agent.history), agent.growth.pool(past)
    best = stage.bank.find(agent.best)
    shown = stage.bank.rows([s.theta for s in past.samples[: past.answered]])
    # Where something that was shown does not hold, another answer alone makes nothing the best.
    by_answers = bool(agent.simulations.held(stage.bank, shown).all())
    return replace(
        known,
        best=agent.best_index,
        influences=influences(pool, past) if by_answers else (),
        menu=_menu(agent, stage, past, best),
        **_wishes(agent, stage, pool, past, best),
        robustness=None if agent.simulations.holds is None else _robustness(agent, stage, past, best),
    )


def _wishes(agent: Screening, stage: Stage, pool: DrawPool, past: History, best: int) -> dict[str, Any]:
    """Return what the person wanted better, and of which KPIs only that a stated limit is kept."""
    reading = agent.simulations.reading
    result = dict(zip(stage.bank.names, stage.bank.kpis[best].tolist(), strict=True))
    found: dict[str, list[tuple[str, float]]] = {"wishes": [], "bounds": []}
    for name, (certainty, value) in wishes(pool, past, stage.spread, best).items():
        # A value beyond the limit, or the aim that leaves room to it, is noticed since it misses that: it
        # says nothing of smaller values.
        ends = (each.get(name, np.inf) for each in (reading.limits, reading.aims))
        bound = any(result[name] <= end < value for end in ends)
        found["bounds" if bound else "wishes"].append((name, certainty))
    return {each: tuple(named) for each, named in found.items()}


def _stakes(agent: Screening, past: History) -> float | None:
    query = None if agent.done else agent.ask()
    if query is None or query.incumbent is None or query.further:
        return None
    past = past.with_pending(agent.history.samples[query.challenger.index])
    try:
        agent.bank.find(query.challenger.theta)
    except KeyError:  # a person asked for it
        return None
    return stakes(agent.growth.pool(past), past, query.incumbent.index)


def _menu(agent: Screening, stage: Stage, past: History, best: int) -> tuple[Alternative, ...]:
    kpis = stage.bank.kpis
    # What never reaches something that the result reaches is no wish of anybody who kept to the result.
    never = stage.bank.hopeless | (np.isinf(kpis) & np.isfinite(kpis[best])).any(axis=1)
    rows = np.array(others(stage.costs, stage.logs, ~never, best), dtype=np.int64)
    held = rows[agent.simulations.held(stage.bank, rows)].tolist()
    thetas = stage.bank.thetas[held].tolist()
    gained = [reason_for(stage, row, best, past).better_in for row in held]
    return tuple(Alternative(tuple(theta), gains) for theta, gains in zip(thetas, gained, strict=True))


def _robustness(agent: Screening, stage: Stage, past: History, best: int) -> RobustResult:
    # The price of holding alone: compare with what promises most of what keeps the limits nominally.
    bank, simulations = stage.bank, agent.simulations
    eligible = simulations.eligible(bank)
    rival = int(np.argmax(np.where(eligible, agent.growth.worth(past).mean(axis=0), -np.inf)))
    runs = simulations.runs_kept(bank.thetas[best])
    kept = int(runs.sum())
    whole = not simulations.reading.missed(bank.names, bank.kpis[[best]])[0]
    first, old = None, bank.find(past.samples[0].theta)
    # What misses other limits as modeled is judged by others: a count beside that of the best would mislead.
    if old != best and np.array_equal(*simulations.list_missed(bank)[[old, best]]):
        first = int(simulations.runs_kept(bank.thetas[old]).sum())
    found = RobustResult(kept, (), bool(~eligible[best]), whole and bool(~eligible.all()), first=first)
    found = replace(found, won=_find_winner(agent, stage, best, kept))
    if kept < ENOUGH:
        by_worth = np.argsort(-agent.growth.worth(past).mean(axis=0), kind="stable")
        rows = np.append(best, by_worth[by_worth != best])
        counts = simulations.steadiest(bank, rows)
        top = rows[counts.argmax()]
        if holds_more(simulations.runs_kept(bank.thetas[top]), runs):
            return replace(found, most=int(counts.max()), **_compare_with(stage, past, best, int(top)))
        if found.winner_has_price or not holds_more(runs, simulations.runs_kept(bank.thetas[rival])):
            return found
    if (
        rival == best
        or found.outdone
        or found.winner_has_price
        or simulations.held(bank, np.array([rival]))[0]
    ):
        return found
    theta = bank.thetas[rival]
    losses = simulations.losses(theta, range(1, ENOUGH + 1))
    return replace(
        found,
        **_compare_with(stage, past, best, rival, worse=False),
        others_kept=int(simulations.runs_kept(theta).sum()),
        losses=tuple(sorted(losses.items(), key=lambda each: -each[1])),
    )


def _find_winner(agent: Screening, stage: Stage, best: int, kept: int) -> Winner | None:
    """Return what won by the answers, if the best, which keeps so many runs, is another that keeps more."""
    history, simulations, bank = agent.history, agent.simulations, stage.bank
    index = history.by_answers
    if index is None or index == agent.best_index:
        return None
    row, count = bank.find(history.samples[index].theta), None
    if np.array_equal(*simulations.list_missed(bank)[[row, best]]):
        count = int(simulations.runs_kept(bank.thetas[row]).sum())
        if count >= kept:  # the answers together speak for the best: that one lost by a slip
            return None
    costs = _compare_with(stage, history.past, best, row, worse=False)["costs"]
    lost = {v.challenger for v in history.verdicts() if v.loser == agent.best_index}
    return Winner(index, count, costs, tuple(sorted(lost)))


def _compare_with(
    stage: Stage, past: History, best: int, other: int, *, worse: bool = True
) -> dict[str, Any]:
    """Return another θ, and its KPIs that are better, or also those that are worse, beside the best's."""
    bank, reason = stage.bank, reason_for(stage, other, best, past)
    names = reason.better_in + reason.worse_in * worse
    pairs = bank.kpis[[best, other]][:, [bank.names.index(name) for name in names]].T.tolist()
    costs = tuple((name, *pair) for name, pair in zip(names, pairs, strict=True))
    return {"costs": costs, "other": tuple(bank.thetas[other].tolist())}


def _find_smaller_change(agent: Screening, known: Findings) -> Findings:
    """Add the smallest change that is as good as the result."""
    past = agent.history.past
    stage = agent.stage(agent.history)
    if agent.best_index is None or not past.lessons or stage.rough or not stage.scale.names:
        return known
    best, draws = agent.best, cautious(agent.growth.pool(past), past)

    def worse(thetas: Float[np.ndarray, "p n"]) -> Float[np.ndarray, " p"]:
        bank = agent.growth.extend(agent.bank, agent.space.encode_all(thetas), thetas)
        return noticed_worse(draws, stage.scale(bank, bank.rows([best, *thetas])))

    start = np.array(past.samples[0].theta)
    return replace(known, smaller=smaller_change(best, start, agent.space, worse))
