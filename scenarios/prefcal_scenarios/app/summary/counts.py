"""Count the experiments and comparisons of a study; nothing else counts them."""

from collections.abc import Mapping
from dataclasses import dataclass

from prefcal_env.preferences.answer import Mark, Preference
from prefcal_env.preferences.history import Comparison
from prefcal_env.study import State


@dataclass(frozen=True, slots=True)
class Counts:
    """Counts of a study that every front end, the report and the JSON show.

    Args:
        experiments: Number of experiments that ran, including that of the open question.
        comparisons: Number of standing answers about two experiments, including follow-up
            comparisons; without those that nobody was asked about since a run was cut short.
        verdicts: Number of comparisons by preference; they add up to `comparisons`.
        retracted: Number of retracted answers; no other number includes them.
    """

    experiments: int
    comparisons: int
    verdicts: Mapping[Preference | None, int]
    retracted: int

    @classmethod
    def of(cls, state: State) -> "Counts":
        """Return the counts of a study. A repeated question is not a new comparison."""
        given = [c.answer.preference for c in answered(state) if not is_unasked(c)]
        verdicts: list[Preference | None] = [*Preference, None]
        return cls(
            experiments=len(state.finished),
            comparisons=len(given),
            verdicts={verdict: given.count(verdict) for verdict in verdicts},
            retracted=sum(c.retracted for c in state.history.counting),
        )


def is_unasked(comparison: Comparison) -> bool:
    """Return whether a run was cut short and counts as worse without a question."""
    cut = Mark.CHALLENGER_CUT_SHORT in comparison.answer.automatic
    return comparison.question is None and cut


def answered(state: State) -> tuple[Comparison, ...]:
    """Return the standing answers about two experiments, in the order given."""
    return tuple(
        c
        for c in state.answers
        if c.incumbent is not None and c.repeats is None and not c.retracted
    )
