"""An interview without a person: a synthetic calibrator answers every question."""

from collections.abc import Callable, Iterator

import numpy as np
from jaxtyping import Float

from prefcal_env.experiment import Experiment
from prefcal_env.preference import Answer, Calibrator
from prefcal_env.study import Comparison

from .interview import Interview
from .moment import Phase


def unattended(
    interview: Interview,
    calibrator: Calibrator[Experiment] | None,
    running: Callable[[Float[np.ndarray, " n"]], None] = lambda theta: None,
) -> Iterator[Comparison]:
    """Answer until the interview is over, yielding every comparison after it is durable.

    `calibrator` is None where the agent is told scores.

    Comparisons that the study held before are not yielded again. `running` hears of each θ,
    physical, shape (n,), before it is run.

    Raises:
        Exception: whatever the scenario's run raised.
        StudyError: the study file cannot be written.
    """
    known = len(interview.now().state.closed)
    while (now := interview.now()).phase is not Phase.OVER:
        if now.phase is Phase.QUESTION:
            assert now.question is not None
            assert calibrator is not None, "an agent that is told scores asks nothing"
            new, old = now.question.challenger, now.question.incumbent
            given = Answer.of(calibrator.prefer(new.experiment, old.experiment))
            now = interview.give(now.question.id, given)
        elif now.phase is Phase.RECORD:
            assert now.pending is not None
            interview.scenario.run(np.array(now.pending.theta))  # says that only a person can
        else:
            if now.pending is not None:
                running(np.array(now.pending.theta))
            interview.work()
            interview.raise_problem()
        for comparison in interview.comparisons(known):
            known += 1
            yield comparison
