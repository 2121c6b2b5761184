"""The loop of a study: ask, run, answer, tell. You can stop it after any answer."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np
from jaxtyping import Float

from prefcal_env.experiments.experiment import End, Experiment

from .answer import Agent, Answer, Calibrator, Mark, Outcomes, Preference, Query
from .runs import Executor, runs_of


def counts_as_unsafe(experiment: Experiment) -> bool:
    """Return whether a run was interrupted because it became unsafe; of several, one is enough.

    A failed run does not count: a broken cable, a full disk or a person who stops a run says
    nothing about θ, and a wrong mark keeps an agent away from a good place for the rest of the
    study. People who know better can mark the experiment, or enter a rig's record as unsafe.
    """
    return any(run.end is End.UNSAFE for run in (experiment, *experiment.runs))


def foregone(challenger: Experiment, incumbent: Experiment | None) -> Answer | None:
    """Return the answer that follows from the runs alone; None if somebody must be asked.

    The first experiment is compared with nothing. A run that was cut short has lost, which is why
    it was cut short.
    """
    if incumbent is None:
        return Answer(None)
    return Answer(Preference.INCUMBENT) if challenger.end is End.CUT_SHORT else None


def completed(
    answer: Answer, challenger: Experiment, incumbent: Experiment | None, outcomes: Outcomes | None = None
) -> Answer:
    """Return `answer` with `outcomes` and the marks that follow from how the two runs ended.

    Marks and outcomes that came with the answer are kept, and such marks are not automatic. Only
    "good enough" is dropped if the same side is unsafe. If the answer is undone or retracted, the
    added marks and outcomes go with it.

    Args:
        answer: Answer about the two experiments.
        challenger: Experiment of the challenger.
        incumbent: Experiment of the incumbent; None in the first query.
        outcomes: KPIs of both; None adds none.
    """
    found = tuple(mark for mark in _facts(challenger, incumbent) if mark not in answer.marks)
    if found:
        marks, automatic = (*answer.marks, *found), (*answer.automatic, *found)
        answer = replace(answer, marks=marks, automatic=automatic)
    good = {
        Mark.CHALLENGER_UNSAFE: Mark.CHALLENGER_GOOD_ENOUGH,
        Mark.INCUMBENT_UNSAFE: Mark.INCUMBENT_GOOD_ENOUGH,
    }
    contradicted = {good[mark] for mark in answer.marks if mark in good}
    if contradicted & set(answer.marks):
        kept = tuple(mark for mark in answer.marks if mark not in contradicted)
        answer = replace(answer, marks=kept)
    if outcomes is not None and answer.outcomes is None:
        answer = replace(answer, outcomes=outcomes)
    return answer


def _facts(challenger: Experiment, incumbent: Experiment | None) -> Iterator[Mark]:
    """Yield the marks that follow from how the two runs ended."""
    if counts_as_unsafe(challenger):
        yield Mark.CHALLENGER_UNSAFE
    if incumbent is not None and counts_as_unsafe(incumbent):
        yield Mark.INCUMBENT_UNSAFE
    if challenger.end is End.CUT_SHORT:
        yield Mark.CHALLENGER_CUT_SHORT


Run = Callable[[Float[np.ndarray, " n"]], Experiment]
R = TypeVar("R")
A = TypeVar("A")


class Step(NamedTuple, Generic[R, A]):
    """One turn of the loop: a closed query, the answer, and the results it is about.

    `incumbent` is None if nothing was compared: in the first query, and for an agent that
    learns from scores.
    """

    query: Query
    answer: A
    challenger: R
    incumbent: R | None

    @property
    def winner(self) -> R:
        """Preferred result; without a preference, the incumbent if there is one."""
        preferred = getattr(self.answer, "preference", None)
        if self.incumbent is None or preferred is Preference.CHALLENGER:
            return self.challenger
        return self.incumbent

    @property
    def winner_index(self) -> int:
        """Index of the winner's sample."""
        incumbent = self.query.incumbent
        wins = incumbent is None or self.winner is self.challenger
        return self.query.challenger.index if wins or incumbent is None else incumbent.index


Comparison = Step[Experiment, Answer]
"""A closed query with both experiments.

`incumbent` is None for the very first experiment, whose answer is an abstention.
"""


def ask_and_tell(
    agent: Any,
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
        agent: Agent of any kind, with `done`, `ask` and `tell`; it is changed. With `at_once`,
            `ask(n)` returns the open queries, as that of `Agent` does.
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
            yield Step(query, given, challenger, incumbent)


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
        said = foregone(challenger, incumbent)
        if said is None:
            assert incumbent is not None
            said = Answer.of(calibrator.prefer(challenger, incumbent))
        pair = None
        if outcome is not None and said.outcomes is None:
            pair = (outcome(challenger), None if incumbent is None else outcome(incumbent))
        return completed(said, challenger, incumbent, pair)

    return ask_and_tell(agent, run, answer)
