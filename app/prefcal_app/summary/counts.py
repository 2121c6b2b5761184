"""Count the experiments and questions of a study; nothing else counts them."""

from collections.abc import Mapping
from dataclasses import dataclass

from prefcal_agents.protocol.agent import Agent
from prefcal_env.preferences.answer import Preference
from prefcal_env.preferences.history import Comparison
from prefcal_env.study import State

VERDICTS: Mapping[Preference | None, str] = {
    Preference.CHALLENGER: "newer better",
    Preference.TIE: "about the same",
    Preference.INCUMBENT: "older better",
    None: "can't tell",
}
"""Text of each verdict, in the order of the counts. The challenger is the newer experiment; the
older one need not be the best so far, since follow-up comparisons can be about other runs."""


@dataclass(frozen=True, slots=True)
class Counts:
    """Counts of a study that every front end, the report and the JSON show.

    Args:
        experiments: Number of experiments that ran, including that of the open question.
        comparisons: Number of standing answers about two experiments, including follow-up
            comparisons.
        verdicts: Number of comparisons by preference; they add up to `comparisons`.
    """

    experiments: int
    comparisons: int
    verdicts: Mapping[Preference | None, int]

    @classmethod
    def of(cls, state: State) -> "Counts":
        """Return the counts of a study. A repeated question is not a new comparison."""
        given = [c.answer.preference for c in answered(state)]
        verdicts: list[Preference | None] = [*Preference, None]
        return cls(
            experiments=len(state.finished),
            comparisons=len(given),
            verdicts={verdict: given.count(verdict) for verdict in verdicts},
        )


@dataclass(frozen=True, slots=True)
class Planned:
    """How many questions a study asks: one for each experiment but the first.

    Follow-up questions, which only some agents ask, are called so and do not count.

    Args:
        answered: Number of questions that are answered.
        total: Number of questions of the whole study.
    """

    answered: int
    total: int

    @classmethod
    def of(cls, agent: Agent) -> "Planned":
        """Return the plan of the study of an agent."""
        return cls(max(agent.history.answered - 1, 0), agent.n_max - 1)

    def place(self, *, over: bool, further: bool) -> str:
        """Return how far the study is, such as "question 3 of 10".

        Args:
            over: Whether the study is over.
            further: Whether the open question is about two known experiments.
        """
        if over:
            done = self.answered >= self.total
            return f"{self.answered} {'' if done else f'of {self.total} '}questions answered"
        if further:
            return f"follow-up question, after {self.answered} of {self.total}"
        return f"question {min(self.answered + 1, self.total)} of {self.total}"


def answered(state: State) -> tuple[Comparison, ...]:
    """Return the standing answers about two experiments, in the order given."""
    return tuple(
        c for c in state.answers if c.incumbent is not None and c.repeats is None and not c.retracted
    )
