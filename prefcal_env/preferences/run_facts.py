"""Add the known facts about two experiments to the answer about them."""

from collections.abc import Iterator
from dataclasses import replace

from prefcal_env.experiments.end import End
from prefcal_env.experiments.experiment import Experiment

from .answer import Answer, Mark, Outcomes


def counts_as_unsafe(experiment: Experiment) -> bool:
    """Return whether a run was interrupted because it became unsafe; of several, one is enough.

    A failed run does not count: a broken cable, a full disk or a person who stops a run says
    nothing about θ, and a wrong mark keeps an agent away from a good place for the rest of the
    study. People who know better can mark the experiment, or enter a rig's record as unsafe.
    """
    return any(run.end is End.UNSAFE for run in (experiment, *experiment.runs))


def completed(
    answer: Answer,
    challenger: Experiment,
    incumbent: Experiment | None,
    outcomes: Outcomes | None = None,
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
    good = {Mark.CHALLENGER_UNSAFE: Mark.CHALLENGER_GOOD_ENOUGH,
            Mark.INCUMBENT_UNSAFE: Mark.INCUMBENT_GOOD_ENOUGH}  # fmt: skip
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
