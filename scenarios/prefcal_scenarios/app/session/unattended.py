"""An interview without a person: a synthetic calibrator answers every question."""

from collections.abc import Callable, Iterator

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import RunError
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.preferences.answer import Answer, Calibrator, Preference
from prefcal_env.preferences.loop import Comparison

from .interview import Interview
from .runs import UNBIDDEN
from .view import Phase, Question

_MOST_LOST = 3
"""Runs in a row that may crash or take too long: then nothing is to be hoped for."""


def unattended(
    interview: Interview,
    calibrator: Calibrator[Experiment] | None,
    running: Callable[[Float[np.ndarray, " n"]], None] = lambda theta: None,
    failed: Callable[[str], None] = lambda words: None,
) -> Iterator[Comparison]:
    """Answer until the interview is over, yielding every comparison after it is durable.

    `calibrator` is None where the agent is told scores.

    Comparisons that the study held before are not yielded again. `running` hears of each θ,
    physical, shape (n,), before it is run, `failed` of each run of an own scenario that crashed or
    took too long: it counts as a failed experiment, and the study goes on.

    Raises:
        Exception: whatever the scenario's run raised, or several crashed or were late in a row.
        StudyError: the study file cannot be written.
    """
    known, lost = interview.now().state.history.answered, 0
    while (now := interview.now()).phase is not Phase.OVER:
        if now.phase is Phase.QUESTION:
            assert now.question is not None
            assert calibrator is not None, "an agent that is told scores asks nothing"
            now = interview.give(now.question.id, _given(calibrator, now.question))
        elif now.phase is Phase.RECORD:
            assert now.pending is not None
            interview.scenario.run(np.array(now.pending.theta))  # says that only a person can
        else:
            if now.pending is not None:
                running(np.array(now.pending.theta))
            interview.work()
            if _lost(interview, lost, failed):
                lost += 1
            elif len(interview.now().state.finished) > len(now.state.finished):
                lost = 0
        for comparison in interview.comparisons(known):
            known += 1
            yield comparison


def _given(calibrator: Calibrator[Experiment], question: Question) -> Answer:
    """The calibrator's answer; a run without any result loses without it being asked."""
    new, old = question.challenger.experiment, question.incumbent.experiment
    nothing = [not len(e.t) and not e.kpis for e in (new, old)]
    if not any(nothing):
        return Answer.of(calibrator.prefer(new, old))
    if all(nothing):
        return Answer(None)
    return Answer(Preference.INCUMBENT if nothing[0] else Preference.CHALLENGER)


def _lost(interview: Interview, before: int, failed: Callable[[str], None]) -> bool:
    """Count a run that crashed or took too long as failed; whether there was one.

    `before` is how many there were in a row. Any other problem is raised.
    """
    now = interview.now()
    if now.phase is not Phase.FAILED:
        return False
    try:
        interview.raise_problem()
    except RunError as error:
        if error.why not in UNBIDDEN or before + 1 >= _MOST_LOST or now.pending is None:
            raise
        failed(f"Experiment {now.pending.index + 1} failed: {error}")
        interview.fail(now.pending.index, str(error))
    return True
