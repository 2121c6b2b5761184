"""The agent Screening: simulate many θ unseen, show those that the answers leave undecided."""

from typing import ClassVar, Self, final

import numpy as np
from jaxtyping import Bool, Float, Int

from prefcal_agents.history.agent_state import AgentState
from prefcal_agents.optimize.search import Tried
from prefcal_agents.protocol.agent import Pair, one_thread
from prefcal_agents.utility.bank import Bank
from prefcal_agents.utility.choice import clearly_apart, expected_best, now_and_next, trend, worth
from prefcal_agents.utility.utilities import Utilities
from prefcal_env.preferences.answer import Preference
from prefcal_env.preferences.history import History

from .beyond_kpis import BeyondKPIs
from .growth import Growth, Stage
from .reason import Reason, chances, reason_for
from .simulating import Simulating
from .simulations import Simulations

_DOUBT = 0.5
"""Probability of being better than the best above which an earlier experiment is shown again."""
_TIMES, _BETWEEN = 2, 5
"""Number of times that a pair is asked at most, and of questions between the two times at least."""
_FOLLOW_UPS = 3
"""Largest number of questions of a study about experiments that were shown before."""
_OPEN = 4
"""Where the simulation is rough, every fourth θ is one that people with any wishes might prefer to
all shown: a few answers between θ that are poor in the same way can teach a wrong preference."""
_ALIKE = 0.005
"""Experiments whose KPIs differ by less than this share look alike."""


@final
class Screening(Simulating):
    """Simulate many θ unseen, learn the person's utility from KPIs, and show few experiments.

    Arguments and errors are those of `Simulating`. n_max experiments take n_max - 1 comparisons,
    and up to three more, in which earlier experiments are shown again. Differences of KPIs that
    people cannot read, by the `reading` of `simulate`, are none.
    """

    version: ClassVar[int] = 4
    most_follow_ups: ClassVar[float] = _FOLLOW_UPS
    _growth: Growth | None = None
    _beyond: BeyondKPIs

    def _begin(self, simulations: Simulations) -> None:
        super()._begin(simulations)
        self._growth = Growth(self.space, simulations, self._n_simulated, self._seed)
        self._beyond = BeyondKPIs(self.space, self._seed)

    # What people and programs look at.

    @property
    def bank(self) -> Bank:
        """Return the simulated θ that the open query was chosen from; it simulates if needed."""
        return self._stage.bank

    @property
    def due(self) -> int:
        """Return the number of θ that are simulated by the time of the open query."""
        return 0 if self._growth is None else self._growth.due(self.history)

    @property
    def _stage(self) -> Stage:
        with one_thread():
            return self._growing.stage(self.history)

    @property
    def reason(self) -> Reason | None:
        """Return why the challenger of the open query is shown; None if nothing is open to compare.

        It simulates if needed.
        """
        query = None if self.done else self.ask()
        if query is None or query.incumbent is None:
            return None
        stage = self._stage
        new, best = (_row(stage.bank, side.theta) for side in (query.challenger, query.incumbent))
        if new is None or best is None:
            return None
        return reason_for(stage, new, best, self.history)

    @property
    def chance_of_better(self) -> float:
        """Return how probably the person prefers the most promising simulated θ to the best one.

        It is one of those that were not shown. 1 before the first answer. It simulates if needed.
        """
        if self.best_index is None or not self.history.lessons():
            return 1.0
        stage = self._stage
        found = chances(stage, stage.bank.find(self.best), self.history)
        for sample in self.history.samples[: self.history.answered]:
            found[stage.bank.find(sample.theta)] = 0.0
        return float(found.max())

    @property
    def trend(self) -> Float[np.ndarray, " n"] | None:
        """Return how expected worth grows along each knob near the best θ; None before an answer.

        It simulates if needed.
        """
        if self.best_index is None or not self.history.lessons():
            return None
        stage = self._stage
        return trend(stage.bank.z, stage.costs, stage.bank.find(self.best))

    @property
    def _growing(self) -> Growth:
        if self._growth is None:
            raise self._unable()
        return self._growth

    # What the agent does.

    def _leader(self, history: History) -> int | None:
        """Return the shown sample with the largest expected worth.

        Every answer has its say by how probable mistakes are, so a wrong one need not cost the best
        experiment its place; the paper's best is the winner of the latest answers (sec. GLISp).
        """
        if self._growth is None or not history.lessons():
            return None
        stage, unsafe = self._growing.stage(history), history.unsafe()
        safe = [i for i in range(history.answered) if i not in unsafe]
        rows = [stage.bank.find(history.samples[i].theta) for i in safe]
        value = dict(zip(safe, worth(stage.costs)[:, rows].mean(axis=0), strict=True))
        winner = history.by_answers  # if another one is worth as much
        return max(safe, key=lambda i: (value[i], i == winner), default=None)

    def _propose(self, history: History) -> Float[np.ndarray, " n"]:
        stage, best = self._growing.stage(history), history.incumbent
        rng = np.random.default_rng([self._seed, history.answered])
        tried = Tried(self.space, history)
        if self._beyond.is_next(history, stage):
            beyond = tried.fresh(self._beyond.propose(history, stage), rng)
            if self._growing.works(beyond):
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
        z = tried.first_new(stage.bank.z[order])
        return tried.fresh(stage.bank.z[0], rng) if z is None else z

    def _poor_beginning(self, stage: Stage, row: int | None) -> Int[np.ndarray, " m"]:
        """Return how little each θ suits the first comparison, 0 is best, shape (m,).

        People begin with two experiments that meet the objectives, and differ clearly.
        """
        names, kpis = stage.bank.names, stage.bank.kpis
        missed = self.simulations.reading.missed(names, kpis)
        if row is None:
            return np.asarray(2 * missed)
        return np.asarray(2 * missed + ~clearly_apart(kpis, missed == missed.min(), row))

    def _follow_up(self, history: History) -> Pair | None:
        """Return an earlier experiment that is probably better than the best, to ask again.

        A wrong answer can have cost it the lead. A tie is no reason to ask again, and the second
        time comes after other questions.
        """
        best = history.incumbent
        if best is None or len(history.lessons()) < 2 or self._growth is None:
            return None
        stage = self._growing.stage(history)
        rows = [stage.bank.find(s.theta) for s in history.samples[: history.answered]]
        doubt = np.mean(stage.costs[:, rows] < stage.costs[:, rows[best], None] - 1.0, axis=0)
        doubt[[best, *history.unsafe()]] = 0.0
        for rival in map(int, np.argsort(-doubt, kind="stable")):
            if doubt[rival] <= _DOUBT:
                return None
            if _may_be_asked(history, rival, best):
                return max(rival, best), min(rival, best)
        return None

    def _final(self, history: History) -> Pair | None:
        return self._follow_up(history)

    def _twin(self, state: AgentState) -> Self:
        twin = super()._twin(state)
        twin._growth = self._growth
        twin._beyond = BeyondKPIs(self.space, self._seed)  # its solver may not be shared
        return twin


def _may_be_asked(history: History, first: int, second: int) -> bool:
    """Return whether a question about two known experiments neither is settled nor comes soon."""
    order = history.in_order()
    places = [k for k, c in enumerate(order) if {c.challenger, c.incumbent} == {first, second}]
    settled = any(order[k].answer.preference is Preference.TIE for k in places)
    soon = bool(places) and len(order) - places[-1] <= _BETWEEN
    return not settled and not soon and len(places) < _TIMES


def _open_minded(stage: Stage, history: History, rng: np.random.Generator) -> int | None:
    """Return the row that people with any wishes might prefer to all that was shown.

    It is one of those that fill the space: near the leaders, all are good or poor in the same way.
    None if all that the simulation does not refuse were shown.
    """
    shown = [stage.bank.find(sample.theta) for sample in history.samples[: history.answered]]
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
    for sample in history.samples[: history.answered]:
        shown = logs[stage.bank.find(sample.theta)]
        apart = np.abs(np.subtract(logs, shown, where=logs != shown, out=np.zeros(logs.shape)))
        alike |= apart.max(axis=1, initial=0.0) < _ALIKE
    return alike


def _row(bank: Bank, theta: Float[np.ndarray, " n"]) -> int | None:
    """Return the row of θ in the bank; None if it is not there, since a person asked for it."""
    try:
        return bank.find(theta)
    except KeyError:
        return None
