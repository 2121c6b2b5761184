"""How much of a study is done: the one place where experiments and comparisons are counted."""

from collections.abc import Mapping
from dataclasses import dataclass

from prefcal_env.preferences.answer import Preference
from prefcal_env.preferences.history import Comparison
from prefcal_env.study import State


@dataclass(frozen=True, slots=True)
class Counts:
    """What every front end, the report and the JSON say of a study.

    Args:
        experiments: Number of experiments that ran, the one of the open question among them.
        comparisons: Number of answers about two experiments that stand, further ones among them.
        verdicts: How many of these gave each preference; they add up to `comparisons`.
        retracted: Number of answers that were taken out again; they are in no other number.
    """

    experiments: int
    comparisons: int
    verdicts: Mapping[Preference | None, int]
    retracted: int

    @classmethod
    def of(cls, state: State) -> "Counts":
        """Of a study. A question that was asked again is no new comparison."""
        given = [c.answer.preference for c in answered(state)]
        verdicts: list[Preference | None] = [*Preference, None]
        return cls(
            experiments=len(state.finished),
            comparisons=len(given),
            verdicts={verdict: given.count(verdict) for verdict in verdicts},
            retracted=sum(c.retracted for c in state.history.counting),
        )


def answered(state: State) -> tuple[Comparison, ...]:
    """The answers about two experiments that stand, in the order given."""
    return tuple(
        c
        for c in state.answers
        if c.incumbent is not None and c.repeats is None and not c.retracted
    )
