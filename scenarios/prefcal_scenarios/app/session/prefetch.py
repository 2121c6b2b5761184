"""Running ahead: what each likely answer would lead to, ready before it is given."""

from collections import OrderedDict
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from prefcal_agents.protocol.agent import Agent
from prefcal_env.errors import RunError
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.preferences.answer import Answer, Preference, Strength

from .view import Question

LIKELY: tuple[tuple[Preference | None, Strength], ...] = (
    (Preference.CHALLENGER, Strength.BETTER),
    (Preference.INCUMBENT, Strength.BETTER),
    (Preference.TIE, Strength.BETTER),
    (None, Strength.BETTER),
    (Preference.INCUMBENT, Strength.MUCH_BETTER),
    (Preference.CHALLENGER, Strength.MUCH_BETTER),
)
"""Answers, the likely ones first."""
_KEPT = 36
"""Experiments in memory: those of a few questions, so that an undo finds them too."""


@dataclass(slots=True)
class Prefetch:
    """Twins of the agent that were told an answer already, and experiments run on suspicion.

    Nothing here is saved: it can be lost at any time, and changes no result.
    """

    _twins: dict[Answer, Agent] = field(default_factory=dict)
    _tried: set[Answer] = field(default_factory=set)
    _experiments: OrderedDict[bytes, Experiment] = field(default_factory=OrderedDict)
    _failures: dict[bytes, RunError] = field(default_factory=dict)
    next: Float[np.ndarray, " n"] | None = None
    """θ that a twin proposes and that is to be run, physical, shape (n,)."""

    def missing(self, asked: Question) -> Answer | None:
        """The next answer to `asked`, complete, that nothing is known about; None if all are."""
        for preference, strength in LIKELY:
            answer = asked.completed(Answer(preference, strength, asked.marks))
            if answer not in self._tried:
                self._tried.add(answer)
                return answer
        return None

    def keep_twin(self, answer: Answer, twin: Agent) -> None:
        """Have `twin` at hand for `answer`."""
        self._twins[answer] = twin

    def take(self, answer: Answer) -> Agent | None:
        """The twin that was told `answer`; all are forgotten, since the question is closed."""
        twin = self._twins.get(answer)
        self.forget()
        return twin

    def forget(self) -> None:
        """Drop the twins: the question has changed."""
        self._twins.clear()
        self._tried.clear()
        self.next = None

    def keep(self, theta: Float[np.ndarray, " n"], experiment: Experiment) -> None:
        """Have the experiment of θ at hand: as it was asked for, whatever θ its plant reports."""
        self._experiments[_key(theta)] = experiment
        while len(self._experiments) > _KEPT:
            self._experiments.popitem(last=False)

    def keep_failure(self, theta: Float[np.ndarray, " n"], error: RunError) -> None:
        """Have it at hand that θ crashed or took too long: nobody has to wait for that twice."""
        self._failures[_key(theta)] = error

    def is_known(self, theta: Float[np.ndarray, " n"]) -> bool:
        """Whether θ was run, and gave an experiment or not."""
        return _key(theta) in self._experiments or _key(theta) in self._failures

    def take_failure(self, theta: Float[np.ndarray, " n"]) -> RunError | None:
        """Return why θ gave no experiment, once: who tries again means it."""
        return self._failures.pop(_key(theta), None)

    def experiment(self, theta: Float[np.ndarray, " n"]) -> Experiment | None:
        """The experiment of θ, if it was run."""
        return self._experiments.get(_key(theta))


def _key(theta: Float[np.ndarray, " n"]) -> bytes:
    return bytes((np.asarray(theta, dtype=float) + 0.0).tobytes())  # -0.0 is 0.0
