"""Read what a study already has: its experiments and its answers."""

from prefcal_app.summary.counts import answered
from prefcal_env.experiments.experiment import End, Experiment
from prefcal_env.preferences.history import Comparison
from prefcal_env.preferences.loop import Comparison as Compared

from . import steps
from .guarded import Guarded
from .study.question import Question


class Past:
    """Experiments and answers of an interview, readable from any thread."""

    def __init__(self, guarded: Guarded) -> None:
        self._guarded = guarded

    def experiment(self, index: int) -> Experiment:
        """Return experiment `index`, from 0. Raises StudyError if there is none."""
        with self._guarded.reading() as flow:
            return flow.store.experiment(index)

    def end(self, index: int) -> End:
        """Return how experiment `index`, from 0, ended. Raises StudyError if there is none."""
        with self._guarded.reading() as flow:
            return flow.store.end(index)

    def asked(self, answer: int) -> Question:
        """Return answered question `answer` as it was shown. Raises StaleError if there is none."""
        with self._guarded.reading() as flow:
            return flow.store.asked(steps.closed(flow, answer))

    def closed(self, answer: int) -> Comparison:
        """Return answer number `answer`, from 1; -1, -2, ... are follow-up comparisons.

        Raises:
            StaleError: If there is none.
        """
        with self._guarded.reading() as flow:
            return steps.closed(flow, answer)

    def comparisons(self, start: int = 0) -> tuple[Compared, ...]:
        """Return every closed query from number `start` on, including the first experiment's."""
        with self._guarded.reading() as flow:
            return tuple(flow.store.comparison(i) for i in range(start, flow.state.history.answered))

    def answered(self) -> tuple[Compared, ...]:
        """Return the comparisons whose answers stand, in order, follow-up comparisons included."""
        with self._guarded.reading() as flow:
            return tuple(flow.store.compared(closed) for closed in answered(flow.state))
