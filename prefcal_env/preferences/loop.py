"""The loop of a study: ask, run, answer, tell. You can stop it after any answer."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Generic, NamedTuple, Protocol, TypeVar

import numpy as np
from jaxtyping import Float

from prefcal_env.experiments.experiment import End, Experiment

from .answer import Agent, Answer, Calibrator, Preference, Query
from .run_facts import completed
from .runs import Executor, runs_of

Run = Callable[[Float[np.ndarray, " n"]], Experiment]
R = TypeVar("R")
A = TypeVar("A")


class AskTell(Protocol):
    """The interface that the loop needs from an agent of any kind.

    To run several experiments at once, `ask(n)` must return the open queries, as `Agent` does.
    """

    @property
    def done(self) -> bool:
        """Return whether it has no more questions."""

    @property
    def ask(self) -> Callable[..., Any]:
        """Return the method that returns the open query."""

    def tell(self, query: Query, answer: Any) -> None:
        """Close `query`."""


class Step(NamedTuple, Generic[R, A]):
    """One turn of the loop: a closed query, the results it is about, and the answer.

    `incumbent` is None if nothing was compared: in the first query, and for an agent that
    learns from scores.
    """

    query: Query
    challenger: R
    incumbent: R | None
    answer: A


def ask_and_tell(
    agent: AskTell,
    run: Callable[[Float[np.ndarray, " n"]], R],
    answer: Callable[[R, R | None], A],
    *,
    at_once: int = 1,
    executor: Executor | None = None,
) -> Iterator[Step[R, A]]:
    """Drive any agent until it is done, yielding each step after the agent has the answer.

    With `at_once`, several experiments run while answers are given. They are asked about in the
    order in which they are ready, which alone decides what is proposed next. If a run raises an
    error, it is raised here, the agent keeps what is pending, and another loop continues with it.

    Args:
        agent: Agent that proposes θ; it is changed.
        run: Function that returns the result of a physical θ, shape (n,); called once for each
            experiment, but again if its worker died and the executor replaces it.
        answer: Function of the results of challenger and incumbent that returns what to tell the
            agent: an answer, or a score of the challenger.
        at_once: Number of experiments that run at the same time, 1 or more.
        executor: Executor that runs them, such as a `ProcessPoolExecutor`; it stays open. Threads
            if None, which suit runs that wait for another program.

    Raises:
        SettingsError: If `at_once` is not valid.
        RunError: If the worker of an experiment died twice, or a pool of processes broke.
    """
    with runs_of(run, at_once, executor) as runs:
        while not agent.done:
            query, challenger, incumbent = runs.next_of(agent)
            given = answer(challenger, incumbent)
            agent.tell(query, given)
            yield Step(query, challenger, incumbent, given)


@dataclass(frozen=True, slots=True)
class Comparison:
    """A closed query with both experiments.

    `incumbent` is None for the very first experiment, whose answer is an abstention.
    """

    query: Query
    answer: Answer
    challenger: Experiment
    incumbent: Experiment | None

    @property
    def winner(self) -> Experiment:
        """Preferred experiment; without a preference, the incumbent if there is one."""
        if self.incumbent is None or self.answer.preference is Preference.CHALLENGER:
            return self.challenger
        return self.incumbent

    @property
    def winner_index(self) -> int:
        """Index of the winner's sample."""
        if self.query.incumbent is None or self.answer.preference is Preference.CHALLENGER:
            return self.query.challenger.index
        return self.query.incumbent.index


def calibrate(
    agent: Agent,
    run: Run,
    calibrator: Calibrator[Experiment],
    outcome: Callable[[Experiment], Mapping[str, float]] | None = None,
) -> Iterator[Comparison]:
    """Drive `agent` until it is done, yielding each comparison after the agent has the answer.

    An experiment that became unsafe is marked as unsafe, whatever the calibrator says; see
    `completed`. One that was cut short loses, and the calibrator is not asked.

    Args:
        agent: Agent that proposes θ; it is changed.
        run: Function that runs one experiment of a physical θ, shape (n,); called once for each θ.
        calibrator: Calibrator that compares challenger and incumbent.
        outcome: Function that returns the KPIs of an experiment by name, lower is better; the
            agent also learns from them. `tracking_kpis` works for any trajectory with a reference.

    Yields:
        The comparisons, `agent.n_max` of them, the first without an incumbent.
    """

    def answer(challenger: Experiment, incumbent: Experiment | None) -> Answer:
        said = Answer(None)
        if incumbent is not None and challenger.end is End.CUT_SHORT:
            said = Answer(Preference.INCUMBENT)  # which is why it was cut short
        elif incumbent is not None:
            said = Answer.of(calibrator.prefer(challenger, incumbent))
        pair = None
        if outcome is not None and said.outcomes is None:
            pair = (outcome(challenger), None if incumbent is None else outcome(incumbent))
        return completed(said, challenger, incumbent, pair)

    for step in ask_and_tell(agent, run, answer):
        yield Comparison(step.query, step.answer, step.challenger, step.incumbent)
