"""What is known of two experiments without asking, and so comes with every answer about them."""

from dataclasses import replace

from prefcal_env.experiments.end import End
from prefcal_env.experiments.experiment import Experiment

from .answer import Answer, Mark, Outcomes


def counts_as_unsafe(experiment: Experiment) -> bool:
    """Whether it was interrupted because it became unsafe; of several runs one is enough.

    A failed run does not count: a cable, a disk or a person who stopped it says nothing of θ, and
    a mark that is wrong keeps an agent away from a good place for the rest of the study. Whoever
    knows better marks it, or says of a rig's record that it became unsafe. Time that is up and a
    plant that has settled are what an experiment should end with.
    """
    return any(run.end is End.UNSAFE for run in (experiment, *experiment.runs))


def completed(
    answer: Answer,
    challenger: Experiment,
    incumbent: Experiment | None,
    outcomes: Outcomes | None = None,
) -> Answer:
    """`answer` with the marks that follow from how the two runs ended, and with `outcomes`.

    What was said stays: a mark that somebody gave is not automatic, and outcomes that came with
    the answer are kept. Only "good enough" falls where the same side is unsafe. An answer that is
    taken back or retracted takes all of it along.

    Args:
        answer: About the two.
        challenger: Its experiment.
        incumbent: Its experiment; None in the first query.
        outcomes: KPIs of both; None leaves them out.
    """
    sides = ((Mark.CHALLENGER_UNSAFE, challenger), (Mark.INCUMBENT_UNSAFE, incumbent))
    found = tuple(
        mark
        for mark, experiment in sides
        if experiment is not None and counts_as_unsafe(experiment) and mark not in answer.marks
    )
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
