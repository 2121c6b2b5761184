"""The loop of a study: ask, run, answer, tell. You can stop it after any answer."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Generic, NamedTuple, Protocol, TypeVar

import numpy as np
from jaxtyping import Float

from prefcal_env.experiments.experiment import Experiment

from .answer import Agent, Answer, Calibrator, Preference, Query
from .run_facts import completed

Run = Callable[[Float[np.ndarray, " n"]], Experiment]
R = TypeVar("R")
A = TypeVar("A")


class AskTell(Protocol):
    """The interface that the loop needs from an agent of any kind."""

    @property
    def done(self) -> bool:
        """Return whether it has no more questions."""

    def ask(self) -> Query:
        """Return the open query."""

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
) -> Iterator[Step[R, A]]:
    """Drive any agent until it is done, yielding each step after the agent has the answer.

    Args:
        agent: Agent that proposes θ; it is changed.
        run: Function that returns the result of a physical θ, shape (n,); called once for each
            experiment.
        answer: Function of the results of challenger and incumbent that returns what to tell the
            agent: an answer, or a score of the challenger.
    """
    results: dict[int, R] = {}
    while not agent.done:
        query = agent.ask()
        for side in (query.challenger, query.incumbent):
            if side is not None and side.index not in results:
                results[side.index] = run(side.theta)
        challenger = results[query.challenger.index]
        incumbent = None if query.incumbent is None else results[query.incumbent.index]
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
    `completed`.

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
        if incumbent is not None:
            said = Answer.of(calibrator.prefer(challenger, incumbent))
        pair = None
        if outcome is not None and said.outcomes is None:
            pair = (outcome(challenger), None if incumbent is None else outcome(incumbent))
        return completed(said, challenger, incumbent, pair)

    for step in ask_and_tell(agent, run, answer):
        yield Comparison(step.query, step.answer, step.challenger, step.incumbent)
