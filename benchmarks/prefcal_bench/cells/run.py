"""Run one cell: the agent proposes, the problem runs, and a calibrator or a value answers."""

import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, redirect_stdout
from dataclasses import replace
from statistics import median
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_agents.agent import one_thread
from prefcal_bench.problems import Outcome, Person, Problem, prefer, problem
from prefcal_env.errors import BenchmarkError, MissingExtraError, ProtocolError
from prefcal_env.knobs import theta_key
from prefcal_env.preferences.answer import Answer, Preference, Query, Suggestion, ask_and_tell
from prefcal_env.wording import described

from .cell import Cell, Result
from .roster import entry
from .simulation import Simulation

Clock = Callable[[], float]
_LAST = 5  # number of proposals at the end of a study that are timed
_ALONE = threading.Lock()  # lock for one cell at a time: third-party agents use numpy's global generator


def run_cell(cell: Cell, clock: Clock | None = None, key: str = "") -> Result:
    """Run `cell` on one thread; the result is the same wherever and whenever it runs.

    Whatever an agent raises becomes a failed result, except for KeyboardInterrupt: it may be
    Ctrl-C. The output of an agent goes to standard error.

    Args:
        cell: Cell to run.
        clock: Clock that times the proposals, in seconds; pass it only if nothing else is running.
        key: Key of the cell in the store; a worker with another version of the agent or the
            problem reports a failure.
    """
    with alone():
        try:
            return _run(cell, clock, key)
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            return Result.failed(cell, described(error))


@contextmanager
def alone() -> Iterator[None]:
    """Run the block on one thread, without output, and with no other cell in this process."""
    with _ALONE, redirect_stdout(sys.stderr), one_thread():
        yield


def _run(cell: Cell, clock: Clock | None, key: str) -> Result:
    where, one = problem(cell.problem), entry(cell.agent)
    if one.missing:
        raise MissingExtraError(one.missing)
    if key and key != cell.key:
        raise BenchmarkError(f"this worker has another version of {cell.agent}, {cell.problem} or prefcal")
    person = where.person(cell.calibrator, cell.seed)
    arguments = (where.space, cell.n_init, cell.n_max, cell.seed)
    simulation = Simulation(where, person.withheld) if one.simulates else None
    agent = one.make(*arguments) if simulation is None else one.make(*arguments, simulation)
    study = CellStudy(agent, where, person, cell.n_max, clock, by_value=one.by_value)
    study.run()
    result = study.result(cell)
    return result if simulation is None else replace(result, simulated=simulation.count)


class CellStudy:
    """Study of one agent; outcomes are kept by θ, so that none is computed twice.

    The loop asks and tells the study, which watches that the agent keeps the rules. With
    `by_value` the agent is told costs, otherwise verdicts. `gaps` and `worth` are those of the θ
    that the agent would return after each experiment, as far as `person` has them.
    """

    def __init__(
        self,
        agent: Any,
        where: Problem,
        person: Person,
        n_max: int,
        clock: Clock | None = None,
        *,
        by_value: bool = False,
    ) -> None:
        self._agent, self._where, self._person = agent, where, person
        self._n_max, self._clock, self._by_value = n_max, clock, by_value
        self._known: dict[bytes, Outcome] = {}
        self._thetas: list[Float[np.ndarray, " n"]] = []
        self.gaps: list[float] = []
        self.worth: list[float] = []
        self._comparisons: list[tuple[int, int, int]] = []
        self._questions: list[int] = []
        self._seconds: list[float] = []
        self._asked = 0

    def run(self) -> None:
        """Answer until the agent is done, recording its state after each answer."""
        for _ in ask_and_tell(self, self._outcome, self._answer):
            row = len(self._thetas) - 1
            self._questions[row:] = [len(self._comparisons)]
            person = self._person
            for score, scores in ((person.gap, self.gaps), (person.worth, self.worth)):
                if score is not None:
                    scores[row:] = [score(self._outcome(self._agent.best))]

    def _answer(self, new: Outcome, old: Outcome | None) -> Answer | Preference | float | None:
        """Return what the agent is told: a cost, a verdict, or a verdict with KPIs."""
        told = self._person.told
        if self._by_value:
            return self._person.cost(new)
        verdict = None if old is None else prefer(self._person.judge, new, old)
        if new.kpis is None:
            return verdict
        return Answer(verdict, outcomes=(told(new), None if old is None else told(old)))

    @property
    def done(self) -> bool:
        """Return whether the agent is done."""
        return bool(self._agent.done)

    def tell(self, query: Query, answer: Answer | Preference | float | None) -> None:
        """Pass the answer on, and note it if it compares two experiments."""
        self._agent.tell(query, answer)
        if query.incumbent is None or self._by_value or isinstance(answer, float):
            return
        verdict = Answer.of(answer).preference
        assert verdict is not None  # see `prefer`
        pair = (query.challenger.index, query.incumbent.index)
        self._comparisons.append((*pair, int(verdict)))

    def ask(self) -> Query:
        """Return the agent's query, timed and checked.

        Raises:
            ProtocolError: If the agent breaks a rule.
            KnobError: If a θ does not fit the space.
        """
        start = self._clock() if self._clock else 0.0
        query: Query = self._agent.ask()
        if self._clock:
            self._seconds.append(self._clock() - start)
        self._asked += 1
        if self._asked > self._n_max**2:  # enough to compare every pair
            raise ProtocolError(f"the agent is not done after {self._n_max**2} answers")
        new, theta = query.challenger.index, query.challenger.theta
        if new == len(self._thetas):
            if new == self._n_max:
                raise ProtocolError(f"the agent wanted more than {new} experiments")
            self._thetas.append(self._where.space.check(theta))
        elif not 0 <= new < len(self._thetas):
            raise ProtocolError(f"experiment {len(self._thetas)} must come next, not {new}")
        for side in (query.challenger, query.incumbent):
            if side is not None:
                self._check(side)
        return query

    def _check(self, suggestion: Suggestion) -> None:
        if not 0 <= suggestion.index < len(self._thetas):
            raise ProtocolError(f"experiment {suggestion.index} has not been asked for yet")
        if not np.array_equal(suggestion.theta, self._thetas[suggestion.index]):
            raise ProtocolError(f"experiment {suggestion.index} had another θ before")

    def _outcome(self, theta: Float[np.ndarray, " n"]) -> Outcome:
        key = theta_key(theta)
        if key not in self._known:
            self._known[key] = self._where.outcome(theta)
        return self._known[key]

    def result(self, cell: Cell) -> Result:
        """Return the result of the study."""
        gap, outcomes = self._person.gap, [self._outcome(theta) for theta in self._thetas]
        visited = None if gap is None else np.minimum.accumulate([gap(one) for one in outcomes])
        names = self._where.kpi_names
        return Result(
            cell,
            thetas=tuple(tuple(theta.tolist()) for theta in self._thetas),
            gaps=tuple(self.gaps) or None,
            visited=None if visited is None else tuple(visited.tolist()),
            worth=tuple(self.worth) or None,
            kpi_names=names,
            kpis=tuple(_kpis(one, names) for one in outcomes if names),
            comparisons=tuple(self._comparisons),
            questions=tuple(self._questions),
            best=tuple(np.asarray(self._agent.best, dtype=float).tolist()),
            seconds=median(self._seconds[-_LAST:]) if self._seconds else None,
        )


def _kpis(outcome: Outcome, names: Sequence[str]) -> tuple[float, ...]:
    """Return the KPIs in order; one that an experiment lacks is infinite."""
    measured = {} if outcome.experiment is None else outcome.experiment.kpis
    values = [float(measured.get(name, np.inf)) for name in names]
    return tuple(np.inf if np.isnan(value) else value for value in values)
