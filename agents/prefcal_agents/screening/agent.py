"""The agent Screening: simulate many θ unseen, show those that the answers leave undecided."""

from typing import ClassVar, Self, final

import numpy as np
from jaxtyping import Bool, Float

from prefcal_agents.history.agent_state import AgentState
from prefcal_agents.optimize.search import Tried
from prefcal_agents.protocol.agent import Pair, one_thread
from prefcal_agents.utility.bank import Bank
from prefcal_agents.utility.utilities import Utilities
from prefcal_env.preferences.history import History

from .beyond_kpis import BeyondKPIs
from .choice import expected_best, worth
from .growth import Growth, Stage
from .reason import Reason, chances, reason_for
from .simulating import Simulating
from .simulations import Simulations

_DOUBT = 0.5
"""Probability of being better than the best above which an earlier experiment is shown again."""
_TIMES = 2
"""Number of times that a pair is asked at most."""
_OPEN = 4
"""Where the simulation is rough, every fourth θ is one that people with any wishes might prefer to
all shown: a few answers between θ that are poor in the same way can teach a wrong preference."""
_ALIKE = 0.005
"""Experiments whose KPIs differ by less than this share look alike."""


@final
class Screening(Simulating):
    """Simulate many θ unseen, learn the person's utility from KPIs, and show few experiments.

    Arguments and errors are those of `Simulating`. n_max experiments take n_max - 1 comparisons,
    and one more for each earlier experiment that is probably better than the best and shown again.
    """

    version: ClassVar[int] = 1
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
        return None if new is None or best is None else reason_for(stage, new, best, self.history)

    @property
    def chance_of_better(self) -> float:
        """Return the probability that the person prefers some simulated θ to the best one shown.

        It is that of the most promising θ that was not shown; 1 before the first answer. It
        simulates if needed.
        """
        if self.best_index is None or not self.history.lessons():
            return 1.0
        stage = self._stage
        found = chances(stage, stage.bank.find(self.best))
        for sample in self.history.samples[: self.history.answered]:
            found[stage.bank.find(sample.theta)] = 0.0
        return float(found.max())

    @property
    def _growing(self) -> Growth:
        if self._growth is None:
            raise self._unable()
        return self._growth

    # What the agent does.

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
        order = np.argsort(-expected_best(stage.costs, row), kind="stable")
        dull = stage.bank.hopeless | _look_alike(stage, history)
        z = tried.first_new(stage.bank.z[order[np.argsort(dull[order], kind="stable")]])
        return tried.fresh(stage.bank.z[0], rng) if z is None else z

    def _follow_up(self, history: History) -> Pair | None:
        """Return an earlier experiment that is probably better than the best, to ask again.

        A wrong answer can have cost it the lead. Each pair is asked at most twice.
        """
        best = history.incumbent
        if best is None or len(history.lessons()) < 2 or self._growth is None:
            return None
        stage = self._growing.stage(history)
        rows = [stage.bank.find(s.theta) for s in history.samples[: history.answered]]
        doubt = np.mean(stage.costs[:, rows] < stage.costs[:, rows[best], None], axis=0)
        doubt[[best, *history.unsafe()]] = 0.0
        for rival in map(int, np.argsort(-doubt, kind="stable")):
            if doubt[rival] <= _DOUBT:
                return None
            times = sum({c.challenger, c.incumbent} == {rival, best} for c in history.counting)
            if times < _TIMES:
                return max(rival, best), min(rival, best)
        return None

    def _final(self, history: History) -> Pair | None:
        return self._follow_up(history)

    def _twin(self, state: AgentState) -> Self:
        twin = super()._twin(state)
        twin._growth = self._growth
        twin._beyond = BeyondKPIs(self.space, self._seed)  # its solver may not be shared
        return twin


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
