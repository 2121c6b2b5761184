"""Run one cell: the agent proposes, the problem runs, and a calibrator or a value answers."""

import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout
from statistics import median
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_agents.protocol.agent import one_thread
from prefcal_env.errors import BenchmarkError, MissingExtraError, ProtocolError, SettingsError
from prefcal_env.preferences.answer import Answer, Query, Suggestion

from .cell import Cell
from .problems import Judge, Outcome, Problem, prefer, problem
from .result import Result
from .roster import entry

Clock = Callable[[], float]
_LAST = 5
"""Number of proposals at the end of a study that are timed."""
_ALONE = threading.Lock()
"""Lock for one cell at a time: third-party agents use numpy's global generator."""


def run_cell(cell: Cell, clock: Clock | None = None, key: str = "") -> Result:
    """Run `cell` on one thread; the result is the same wherever and whenever it runs.

    An error becomes a failed result, not an exception. The output of an agent goes to standard
    error.

    Args:
        cell: Cell to run.
        clock: Clock that times the proposals, in seconds; pass it only if nothing else is running.
        key: Key of the cell in the store; a worker with another version of the agent or the
            problem reports a failure.
    """
    with alone():
        try:
            return _run(cell, clock, key)
        except (Exception, SystemExit) as error:
            return Result.failed(cell, f"{type(error).__name__}: {error}")


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
        raise BenchmarkError(
            f"this worker has another version of {cell.agent}, {cell.problem} or prefcal"
        )
    if cell.calibrator not in where.calibrators:
        raise SettingsError(
            f"calibrator of {cell.problem} must be one of {', '.join(where.calibrators)}, "
            f"got {cell.calibrator!r}"
        )
    judge = where.calibrators[cell.calibrator](cell.seed)
    agent = one.make(where.space, cell.n_init, cell.n_max, cell.seed)
    study = _Study(agent, where, judge, cell.n_max, clock)
    if one.kind == "value":
        study.by_value()
    else:
        study.by_preference()
    return study.result(cell)


class _Study:
    """Study of one agent; outcomes are kept by θ, so that none is computed twice."""

    def __init__(
        self, agent: Any, where: Problem, judge: Judge, n_max: int, clock: Clock | None
    ) -> None:
        self._agent, self._where, self._judge = agent, where, judge
        self._n_max, self._clock = n_max, clock
        self._known: dict[bytes, Outcome] = {}
        self._thetas: list[Float[np.ndarray, " n"]] = []
        self._gaps: list[float] = []
        self._questions: list[int] = []
        self._seconds: list[float] = []
        self._asked = 0

    def by_preference(self) -> None:
        """Answer questions until the agent is done."""
        asked = 0
        while not self._agent.done:
            query = self._ask()
            new, preference = self._tried(query.challenger), None
            old = None if query.incumbent is None else self._tried(query.incumbent)
            if old is not None:
                asked += 1
                preference = prefer(self._judge, new, old)
            kpis = None if new.kpis is None else (new.kpis, None if old is None else old.kpis)
            self._agent.tell(
                query, preference if kpis is None else Answer(preference, outcomes=kpis)
            )
            self._note(asked)

    def by_value(self) -> None:
        """Pass values to the agent until it is done, without questions."""
        while not self._agent.done:
            query = self._ask()
            self._agent.tell(query, self._tried(query.challenger).cost)
            self._note(0)

    def _ask(self) -> Query:
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
        return query

    def _tried(self, suggestion: Suggestion) -> Outcome:
        if not 0 <= suggestion.index < len(self._thetas):
            raise ProtocolError(f"experiment {suggestion.index} has not been asked for yet")
        if not np.array_equal(suggestion.theta, self._thetas[suggestion.index]):
            raise ProtocolError(f"experiment {suggestion.index} had another θ before")
        return self._outcome(suggestion.theta)

    def _outcome(self, theta: Float[np.ndarray, " n"]) -> Outcome:
        key = (theta + 0.0).tobytes()  # + 0.0 turns -0.0 into 0.0
        if key not in self._known:
            self._known[key] = self._where.outcome(theta)
        return self._known[key]

    def _note(self, asked: int) -> None:
        """Record the state after the latest answer in the row of the latest experiment."""
        row = len(self._thetas) - 1
        self._questions[row:] = [asked]
        if self._where.has_cost:
            self._gaps[row:] = [self._where.gap(self._outcome(self._agent.best))]

    def result(self, cell: Cell) -> Result:
        """Return the result of the study."""
        gaps, visited = None, None
        if self._where.has_cost:
            gaps = tuple(self._gaps)
            each = [self._where.gap(self._outcome(theta)) for theta in self._thetas]
            visited = tuple(np.minimum.accumulate(each).tolist())
        return Result(
            cell,
            thetas=tuple(tuple(theta.tolist()) for theta in self._thetas),
            gaps=gaps,
            visited=visited,
            questions=tuple(self._questions),
            best=tuple(np.asarray(self._agent.best, dtype=float).tolist()),
            seconds=median(self._seconds[-_LAST:]) if self._seconds else None,
        )
