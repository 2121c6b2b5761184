"""The loop of a study: ask, run, compare, tell. You can stop it between any two comparisons."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from prefcal_env.experiments.experiment import Experiment

from .answer import Agent, Answer, Calibrator, Preference, Query
from .run_facts import completed

Run = Callable[[Float[np.ndarray, " n"]], Experiment]


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
    """Drive `agent` until it is done, yielding each comparison after the agent is told.

    An experiment that became unsafe is marked as such, whatever the calibrator says: see
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
    experiments: dict[int, Experiment] = {}
    while not agent.done:
        query = agent.ask()
        for side in (query.challenger, query.incumbent):
            if side is not None and side.index not in experiments:
                experiments[side.index] = run(side.theta)
        challenger = experiments[query.challenger.index]
        incumbent = None if query.incumbent is None else experiments[query.incumbent.index]
        answer = Answer(None)
        if incumbent is not None:
            answer = Answer.of(calibrator.prefer(challenger, incumbent))
        pair = None
        if outcome is not None and answer.outcomes is None:
            pair = (outcome(challenger), None if incumbent is None else outcome(incumbent))
        answer = completed(answer, challenger, incumbent, pair)
        agent.tell(query, answer)
        yield Comparison(query, answer, challenger, incumbent)
