"""Work on a study beside the person who answers, or without one."""

import threading
from collections.abc import Callable, Iterator
from contextlib import nullcontext, suppress
from typing import Self

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import RunError
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.preferences.answer import Answer, Calibrator, Comparison, Preference
from prefcal_env.wording import in_words, locate
from prefcal_env.workers import GRACE

from .actions import Fail, Give
from .interview import Interview
from .runs import UNBIDDEN
from .study import Now, Phase, Question

# --- Run an interview's experiments in a thread while a person looks at the last one.

_DRAWN = 0.15  # seconds left for sending and drawing a new question before prefetching starts


class Background:
    """Threads that run `interview.work`, one for each experiment that may run at the same time."""

    def __init__(self, interview: Interview) -> None:
        self._interview = interview
        # A daemon, since an hour-long experiment must not keep a closed program alive.
        self._threads = [
            threading.Thread(target=self._loop, name="experiments", daemon=True)
            for _ in range(interview.at_once)
        ]

    def __enter__(self) -> Self:
        self._interview.wait_for_work(0.0)  # from now on others may wait for what is worked out here
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._interview.close()
        while self._interview.drives and self._threads[0].is_alive():
            self._threads[0].join(timeout=0.2)  # the live plant gets its old values back
        for thread in self._threads:
            thread.join(timeout=1.0 + GRACE)

    def _loop(self) -> None:
        # An error of the compiler occurs again in the first experiment, which shows it.
        with suppress(Exception):
            self._interview.prepare()
        seen = None
        while True:
            now = self._interview.now()
            if now.phase is Phase.QUESTION and now.question is not seen:
                seen = now.question
                self._interview.wait(now.version, _DRAWN)
            if not (self._interview.work() or self._interview.wait_for_work()):
                return


# --- Run an interview without a person: a synthetic calibrator answers every question.

_PATIENCE = 0.5  # longest wait for an experiment that runs elsewhere, in seconds
_MOST_LOST = 3  # runs in a row without an experiment after which the study is given up


def unattended(
    interview: Interview,
    calibrator: Calibrator[Experiment] | None,
    running: Callable[[Float[np.ndarray, " n"]], None] = lambda theta: None,
    failed: Callable[[str], None] = lambda words: None,
) -> Iterator[Comparison]:
    """Answer until the interview is over or closed; yield every comparison once it is saved.

    Comparisons that the study already held are not yielded again.

    Args:
        calibrator: Calibrator that answers; None if the agent learns from scores.
        running: Function called with each θ, physical, shape (n,), before it runs.
        failed: Function called with a message for each run that crashed, raised an error or took
            too long, which counts as a failed experiment.

    Raises:
        Exception: If the scenario's run raised it before any experiment was there, or several runs
            in a row raised errors, crashed or took too long.
        StudyError: If the study file cannot be written.
    """
    known = interview.now().state.history.answered
    with Background(interview) if interview.at_once > 1 else nullcontext():
        for _ in _driven(interview, calibrator, running, failed):
            for comparison in interview.past.comparisons(known):
                known += 1
                yield comparison


def _driven(
    interview: Interview,
    calibrator: Calibrator[Experiment] | None,
    running: Callable[[Float[np.ndarray, " n"]], None],
    failed: Callable[[str], None],
) -> Iterator[None]:
    """Take one step after the other until the interview is over or closed; yield after each."""
    lost = 0
    while not interview.is_closed and (now := interview.now()).phase is not Phase.OVER:
        if now.phase is Phase.QUESTION:
            assert now.question is not None
            assert calibrator is not None, "an agent that is told scores asks nothing"
            interview.do(Give(now.question.id, _given(calibrator, now.question)))
        elif now.phase in (Phase.RECORD, Phase.CONFIRM):
            assert now.pending is not None
            interview.scenario.source.run(np.array(now.pending.theta))  # says that only a person can
        else:
            if now.pending is not None:
                running(np.array(now.pending.theta))
            if interview.at_once == 1:
                interview.work()
            elif now.phase is not Phase.FAILED:  # the background works
                interview.wait(now.version, _PATIENCE)
            if _lost(interview, lost, failed):
                lost += 1
            elif len(interview.now().state.finished) > len(now.state.finished):
                lost = 0
        yield
    yield
    while interview.at_once == 1 and not interview.is_closed and interview.work():
        pass  # what is said of the result


def _given(calibrator: Calibrator[Experiment], question: Question) -> Answer:
    """Return the calibrator's answer; a run without any result loses without asking."""
    new, old = question.challenger.experiment, question.incumbent.experiment
    nothing = [not len(e.t) and not e.kpis for e in (new, old)]
    if not any(nothing):
        return Answer.of(calibrator.prefer(new, old))
    if all(nothing):
        return Answer(None)
    return Answer(Preference.INCUMBENT if nothing[0] else Preference.CHALLENGER)


def _lost(interview: Interview, before: int, failed: Callable[[str], None]) -> bool:
    """Count a run that crashed, raised an error or took too long as failed; return whether there was one.

    `before` is the number of such runs in a row so far. Any other problem is raised.
    """
    now = interview.now()
    if now.phase is not Phase.FAILED:
        return False
    try:
        interview.raise_problem()
    except Exception as error:
        if now.pending is None or before + 1 >= _MOST_LOST or not _is_of_this_run(error, now):
            raise
        failed(f"Experiment {now.pending.index + 1} failed: {in_words(locate(error))}")
        interview.do(Fail(now.pending.index, in_words(error)))
    return True


def _is_of_this_run(error: Exception, now: Now) -> bool:
    """Return whether `error` says something of the θ that ran, and not of the scenario or the study."""
    if now.state.history.answered not in now.state.failures:
        return False  # a full disk, for example
    if isinstance(error, RunError) and error.why != "raised":
        return error.why in UNBIDDEN
    return bool(now.state.finished)  # code that has never given an experiment is mended first
