"""The agent Screening: simulate many θ unseen, show those that the answers leave undecided."""

from dataclasses import replace
from typing import ClassVar, final

import numpy as np
from jaxtyping import Bool, Float, Int

from prefcal_agents.glisp.selection import ModelSelection
from prefcal_agents.glisp.settings import GLISpSettings
from prefcal_agents.glisp.strategy import propose
from prefcal_agents.history.stages import Remembered
from prefcal_agents.optimize.search import Tried
from prefcal_agents.protocol.agent import Pair, one_thread
from prefcal_agents.space.setup import Setup
from prefcal_agents.utility.bank import Bank
from prefcal_agents.utility.choice import (
    LOOK,
    clearly_apart,
    expected_best,
    now_and_next,
    overtaking,
    trend,
    worth,
)
from prefcal_agents.utility.influence import Influence, influences, stakes
from prefcal_agents.utility.menu import others
from prefcal_agents.utility.posterior import AFTER, explains
from prefcal_agents.utility.smaller_change import SmallerChange, smaller_change
from prefcal_agents.utility.utilities import Utilities
from prefcal_agents.utility.wishes import cautious, noticed_worse, wishes
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.preferences.history import Comparison, History

from .certificate import FROM, Certificate, Evidence, evidence
from .growth import Growth, Stage
from .reason import Reason, RobustResult, chances, reason_for
from .simulations import ENOUGH, Simulating, Simulations

_OPEN = 4
"""Where the simulation is rough, every fourth θ is one that people with any wishes might prefer to
all shown: a few answers between θ that are poor in the same way can teach a wrong preference."""
_ALIKE = 0.005
"""Experiments whose KPIs differ by less than this share look alike."""

_LAST = 5
"""Number of last questions of a robust study that show what holds, if anything does."""
_STALLED = 5
"""Number of challengers lost in a row after which every second one is proposed without KPIs."""
_UNTIL, _EVERY = 30, 4
"""Until so many answers, every fourth such proposal fills the space, as the start of GLISp does."""


@final
class Screening(Simulating):
    """Simulate many θ unseen, learn the person's utility from KPIs, and show few experiments.

    Arguments and errors are those of `Simulating`. n_max experiments take n_max - 1 comparisons:
    nothing is asked twice. Differences of KPIs that people cannot read, by the `reading` of
    `simulate`, are none.
    """

    version: ClassVar[int] = 5

    @property
    def _growth(self) -> Growth:
        return self.simulations.learned(Growth, self.space, self.n_simulated, self.setup.seed)

    def _prepare(self) -> None:
        self._stages = Remembered(self._stage_after)
        self._evidences = Remembered(self._evidence_after)

    def _stage_after(self, history: History) -> Stage:
        with one_thread():
            return self._growth.stage(history)

    # What people and programs look at.

    @property
    def bank(self) -> Bank:
        """Return the simulated θ that the open query was chosen from; it simulates if needed."""
        return self._stages(self.history).bank

    @property
    def due(self) -> int:
        """Return the number of θ that are simulated by the time of the open query."""
        return 0 if self._simulations is None else self._growth.due(self.history)

    @property
    def reason(self) -> Reason | None:
        """Return why the challenger of the open query is shown; None if nothing is open to compare.

        It simulates if needed.
        """
        query = None if self.done else self.ask()
        if query is None or query.incumbent is None:
            return None
        stage = self._stages(self.history)
        new, best = (_row(stage.bank, side.theta) for side in (query.challenger, query.incumbent))
        if new is None or best is None:
            return None
        kept = None
        if self.simulations.holds is not None:
            kept = int(self.simulations.runs_kept(stage.bank.thetas[[new]])[0])
        return replace(reason_for(stage, new, best, self.history), kept=kept)

    @property
    def chance_of_better(self) -> float:
        """Return how probably the person prefers the most promising simulated θ to the best one.

        It is one of those that were not shown. 1 before the first answer. It simulates if needed.
        """
        if self.best_index is None or not self.history.lessons():
            return 1.0
        stage = self._stages(self.history)
        found = chances(stage, stage.bank.find(self.best), self.history)
        found[stage.bank.rows([s.theta for s in self.history.samples[: self.history.answered]])] = 0.0
        return float(found.max())

    @property
    def evidence(self) -> Evidence | None:
        """Return what draws and answers say of the best θ so far; it simulates if needed.

        None before the second answer, and where experiments measured other KPIs than those
        simulated, on which no certificate was measured.
        """
        (found,) = self._evidences(self._past)
        return found

    def _evidence_after(self, history: History) -> tuple[Evidence | None]:
        best = self.leader(history)
        if best is None or len(history.lessons()) < FROM:
            return (None,)
        stage = self._stages(history)
        row = None if stage.rough else _row(stage.bank, np.array(history.samples[best].theta))
        return (None if row is None else evidence(stage, row, history),)

    @property
    def certificate(self) -> Certificate | None:
        """Return what can be said of the best θ so far; None where there is no `evidence`."""
        found = self.evidence
        return None if found is None else Certificate.of(found)

    @property
    def trend(self) -> Float[np.ndarray, " n"] | None:
        """Return how expected worth grows along each knob near the best θ; None before an answer.

        It simulates if needed.
        """
        if self.best_index is None or not self.history.lessons():
            return None
        stage = self._stages(self.history)
        return trend(stage.bank.z, stage.costs, stage.bank.find(self.best))

    @property
    def influences(self) -> tuple[Influence, ...]:
        """Return what the result would be if each answer were the other way round.

        It simulates if needed.
        """
        past = self._past
        return influences(self._growth.pool(past), past) if past.lessons() else ()

    @property
    def stakes(self) -> float | None:
        """Return how probably the answer to the open query changes the best; None if nothing new is compared.

        It simulates if needed.
        """
        query = None if self.done else self.ask()
        if query is None or query.incumbent is None or query.further:
            return None
        past = self._past.with_pending(self.history.samples[query.challenger.index])
        if _row(self.bank, query.challenger.theta) is None:
            return None
        return stakes(self._growth.pool(past), past, query.incumbent.index)

    @property
    def robustness(self) -> RobustResult | None:
        """Return how the best θ so far holds, and what that costs; None if the study is not robust.

        None before an answer that teaches, too. It simulates if needed.
        """
        if self.simulations.holds is None or self.best_index is None or not self.history.lessons():
            return None
        stage = self._stages(self.history)
        bank = stage.bank
        best, rival = bank.find(self.best), int(np.argmax(worth(stage.costs).mean(axis=0)))
        kept, other = self.simulations.runs_kept(bank.thetas[[best, rival]]).tolist()
        if rival == best or other == ENOUGH:
            return RobustResult(kept, {})
        names = reason_for(stage, rival, best, self._past).better_in
        pairs = bank.kpis[[best, rival]][:, [bank.names.index(name) for name in names]].T
        return RobustResult(kept, dict(zip(names, map(tuple, pairs.tolist()), strict=True)))

    @property
    def menu(self) -> dict[int, tuple[str, ...]]:
        """Return rows of the bank that people like this one might prefer, with the KPIs that they gain.

        The KPI that matters most comes first. There are up to two, as different as they can be; in a robust
        study those that do not hold are left out. It simulates if needed.
        """
        if self.best_index is None or not self.history.lessons():
            return {}
        stage, past = self._stages(self.history), self._past
        best = stage.bank.find(self.best)
        rows = others(stage.costs, stage.logs, ~stage.bank.hopeless, best)
        held = [row for row in rows if self._holds(stage.bank, row)]
        return {row: reason_for(stage, row, best, past).better_in for row in held}

    @property
    def wishes(self) -> dict[str, float]:
        """Return the KPIs that the person surely wanted better, with how sure; it simulates if needed."""
        past = self._past
        if self.best_index is None or not past.lessons():
            return {}
        stage = self._stages(self.history)
        return wishes(self._growth.pool(past), past, stage.spread, stage.bank.find(self.best))

    @property
    def smaller_change(self) -> SmallerChange | None:
        """Return the best θ with knobs as in the given start, so that people hardly notice; it simulates.

        None without a given start, if no knob can be put back, and where experiments measured other
        KPIs than those simulated.
        """
        past = self._past
        if self.best_index is None or not self.setup.start or not past.lessons():
            return None
        stage = self._stages(self.history)
        if stage.rough or not stage.scale.names:
            return None
        draws = cautious(self._growth.pool(past), past)

        def chances(thetas: Float[np.ndarray, "p n"]) -> Float[np.ndarray, " p"]:
            bank = self.with_simulated(thetas)
            return noticed_worse(draws, stage.scale(bank, bank.rows([self.best, *thetas])))

        return smaller_change(self.best, np.array(past.samples[0].theta), self.space, chances)

    def with_simulated(self, thetas: Float[np.ndarray, "p n"]) -> Bank:
        """Return the bank with more θ, physical, shape (p, n); it simulates them."""
        return self._growth.extended(self.bank, self.space.encode_all(thetas), thetas)

    def _holds(self, bank: Bank, row: int) -> bool:
        """Return whether a row keeps the limits in all perturbed runs; without `holds` any does."""
        return bool(self.simulations.runs_kept(bank.thetas[[row]])[0] == ENOUGH)

    @property
    def _past(self) -> History:
        return self.history.until(self.history.answered)

    # What the agent does.

    def _leader(self, history: History) -> int | None:
        """Return the sample of the largest worth that is probably better than the answers' best.

        One wrong answer can cost the best experiment its place. All answers and the KPIs together
        give it back without a question. In a robust study the best one that holds takes the place of
        one that does not.
        """
        best = history.by_answers
        if best is None or len(history.lessons()) < 2 or self._simulations is None:
            return None
        stage = self._stages(history)
        rows = stage.bank.rows([s.theta for s in history.samples[: history.answered]])
        better = np.mean(stage.costs[:, rows] < stage.costs[:, rows[best], None] - 1.0, axis=0)
        if self.simulations.holds is not None:
            held = self.simulations.runs_kept(stage.bank.thetas[rows]) == ENOUGH
            better = better * held if held[best] else held.astype(float)
        rivals = overtaking(better, history) > 0
        if not rivals.any():
            return None
        value = np.where(rivals, worth(stage.costs)[:, rows].mean(axis=0), -np.inf)
        return int(np.argmax(value))

    def has_enough(self, history: History) -> bool:
        """Return whether little is left by the certificate, and the best misses no objective and holds."""
        past = history.until(history.answered)
        (found,), best = self._evidences(past), self.leader(past)
        if found is None or best is None or not Certificate.of(found).enough:
            return False
        bank = self._stages(past).bank
        row = bank.find(np.array(past.samples[best].theta))
        return (
            self._holds(bank, row) and not self.simulations.reading.missed(bank.names, bank.kpis[[row]]).any()
        )

    def question(self, history: History) -> Pair | None:
        """Return None: nothing is asked twice."""
        return None

    def propose(self, history: History) -> Float[np.ndarray, " n"]:
        """Return the simulated point that the answers leave most undecided, or one beyond KPIs."""
        stage, best = self._stages(history), history.incumbent
        rng = np.random.default_rng([self.setup.seed, history.answered])
        tried = Tried(self.space, history)
        if without_kpis(history, stage):
            others = self.simulations.learned(BeyondKPIs, self.space, self.setup.seed)
            beyond = tried.fresh(others.propose(history, stage), rng)
            if self._growth.works(beyond):
                return beyond
        if stage.rough and history.answered % _OPEN == 0:
            found = _open_minded(stage, history, rng)
            if found is not None:
                return tried.fresh(stage.bank.z[found], rng)
        row = None if best is None else stage.bank.find(history.samples[best].theta)
        allowed = ~(stage.bank.hopeless | _look_alike(stage, history))
        if row is None or not history.lessons():
            value = expected_best(stage.costs, row)
            poor = self._poor_beginning(stage, row) + 1000 * ~allowed
            order = np.lexsort([-value, poor])
        else:
            order = np.argsort(-now_and_next(stage.costs, row, allowed), kind="stable")
        if self.simulations.holds is not None:
            order = self._robust_first(stage, order, allowed, history.answered)
        z = tried.first_new(stage.bank.z[order])
        return tried.fresh(stage.bank.z[0], rng) if z is None else z

    def _robust_first(
        self, stage: Stage, order: Int[np.ndarray, " m"], allowed: Bool[np.ndarray, " m"], answered: int
    ) -> Int[np.ndarray, " m"]:
        """Return rows in order behind the first that keeps the limits in all perturbed runs.

        It is one of those that promise most, and one that never reaches something, which holds easily,
        only if it promises more than all others: if there is none, one that does not hold teaches
        more. The last questions look at all θ, those of the largest worth first.
        """
        most, rest = np.split(order[allowed[order]], [LOOK])
        if self.n_max - answered <= _LAST:
            by_worth = np.argsort(-worth(stage.costs).mean(axis=0)[rest], kind="stable")
            most = np.append(most, rest[by_worth])
        else:
            finite = np.isfinite(stage.bank.kpis).all(axis=1)
            most = most[finite[most] | (most == order[0])]
        for row in most:
            if self._holds(stage.bank, row):
                return np.append(row, order[order != row])
        return order

    def _poor_beginning(self, stage: Stage, row: int | None) -> Int[np.ndarray, " m"]:
        """Return how little each θ suits the first comparison, 0 is best, shape (m,).

        People begin with two experiments that meet the objectives, and differ clearly.
        """
        names, kpis = stage.bank.names, stage.bank.kpis
        missed = self.simulations.reading.missed(names, kpis)
        if row is None:
            return np.asarray(2 * missed)
        return np.asarray(2 * missed + ~clearly_apart(kpis, missed == missed.min(), row))


def _open_minded(stage: Stage, history: History, rng: np.random.Generator) -> int | None:
    """Return the row that people with any wishes might prefer to all that was shown.

    It is one of those that fill the space: near the leaders, all are good or poor in the same way.
    None if all that the simulation does not refuse were shown.
    """
    shown = stage.bank.rows([sample.theta for sample in history.samples[: history.answered]])
    rest = np.setdiff1d(stage.spread[~stage.bank.hopeless[stage.spread]], shown)
    if not len(rest):
        return None
    rows = np.concatenate([shown, rest]).astype(np.int64)
    found = worth(Utilities.drawn(stage.scale, len(stage.costs), rng).costs(stage.logs[rows]))
    best = found[:, : len(shown)].max(axis=1, keepdims=True)
    gain = np.maximum(found[:, len(shown) :] - best, 0.0)
    return int(rest[np.argmax(gain.mean(axis=0))])


def _look_alike(stage: Stage, history: History) -> Bool[np.ndarray, " m"]:
    """Return which θ have the KPIs of one that was shown, shape (m,): a person sees nothing new."""
    logs = stage.logs
    alike = np.zeros(len(logs), dtype=np.bool_)
    for shown in logs[stage.bank.rows([s.theta for s in history.samples[: history.answered]])]:
        apart = np.abs(np.subtract(logs, shown, where=logs != shown, out=np.zeros(logs.shape)))
        alike |= apart.max(axis=1, initial=0.0) < _ALIKE
    return alike


def _row(bank: Bank, theta: Float[np.ndarray, " n"]) -> int | None:
    """Return the row of θ in the bank; None if it is not there, since a person asked for it."""
    try:
        return bank.find(theta)
    except KeyError:
        return None


def without_kpis(history: History, stage: Stage) -> bool:
    """Return whether the next θ is proposed without KPIs."""
    known = not stage.bank.hopeless[stage.spread].all()
    return known and (is_stalled(history) or not explains(history, stage.bank, stage.scale, stage.utilities))


def is_stalled(history: History) -> bool:
    """Return whether it is the turn of a proposal without KPIs, since those with them all lost."""
    lessons = history.lessons()
    lost = not any(_won(c) for c in lessons[-_STALLED:])
    strict = any(c.answer.preference for c in lessons)
    return len(lessons) >= AFTER and len(lessons) % 2 == 1 and lost and strict


def _won(comparison: Comparison) -> bool:
    """Return whether the challenger won."""
    verdict = comparison.verdict
    return verdict is not None and verdict.winner == comparison.challenger


class BeyondKPIs:
    """Proposals from answers and θ alone; what it remembers only saves time."""

    def __init__(self, simulations: Simulations, space: KnobSpace, seed: int) -> None:
        self._models = ModelSelection(Setup(space, AFTER, seed, GLISpSettings(kpis=False)))

    def propose(self, history: History, stage: Stage) -> Float[np.ndarray, " n"]:
        """Return the next point of the cube, shape (n,)."""
        count = len(history.lessons())
        if count < _UNTIL and count % _EVERY == _EVERY - 1:
            rows = stage.spread[~stage.bank.hopeless[stage.spread]]
            return np.asarray(stage.bank.z[rows[count % len(rows)]])
        return propose(self._models.setup, self._models.fit(history))
