"""Hold what is thought of in advance; it can be lost at any time without changing a result."""

from collections import OrderedDict
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from prefcal_agents.protocol.agent import Agent
from prefcal_app.simulating import Basis, Simulator, past_of
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.knobs.key import theta_key
from prefcal_env.preferences.answer import Answer, Preference
from prefcal_env.preferences.history import History
from prefcal_scenarios.scenario import Scenario

from ..study.now import Question

LIKELY = (Preference.CHALLENGER, Preference.INCUMBENT, Preference.TIE, None)
"""Possible answers, the most likely first."""
LIKELIEST = 3
"""Number of answers to prepare if each of them takes simulations."""
_KEPT = 36
"""Number of experiments in memory: a few questions' worth, so that an undo finds them, too."""


@dataclass(slots=True)
class Prefetch:
    """What likely answers would lead to, and experiments run in advance.

    Nothing here is saved: it can be lost at any time without changing a result. What the agent
    would ask next is remembered by the agent itself.
    """

    _bases: dict[Answer, Basis] = field(default_factory=dict)
    _tried: set[Answer] = field(default_factory=set)
    _experiments: OrderedDict[bytes, Experiment] = field(default_factory=OrderedDict)
    _failures: dict[bytes, Exception] = field(default_factory=dict)
    next: Float[np.ndarray, " n"] | None = None
    """θ that a copy proposes and that should run next, physical, shape (n,)."""
    busy: Answer | None = None
    """Answer that a copy is learning now, in the background."""
    explained: bool = False
    """Whether the basis of the open question was looked for."""
    told: bool = False
    """Whether what its answer can change was looked for, or what the result rests on."""

    def missing(self, asked: Question, most: int = len(LIKELY)) -> Answer | None:
        """Return the next of the `most` likeliest answers to `asked`; None if all were tried."""
        for preference in LIKELY[:most]:
            answer = asked.completed(Answer(preference, marks=asked.marks))
            if answer not in self._tried:
                self._tried.add(answer)
                return answer
        return None

    def keep_basis(self, answer: Answer, basis: Basis | None) -> None:
        """Keep what the question after `answer` would be chosen from."""
        if basis is not None:
            self._bases[answer] = basis

    def take(self, answer: Answer) -> Basis | None:
        """Return what the question after `answer` is chosen from, and drop the others."""
        basis = self._bases.get(answer)
        self.forget()
        return basis

    def forget(self) -> None:
        """Drop what likely answers lead to, since the question has changed."""
        self._bases.clear()
        self._tried.clear()
        self.next, self.explained, self.told = None, False, False

    def keep(self, theta: Float[np.ndarray, " n"], experiment: Experiment) -> None:
        """Keep the experiment of the requested θ; the plant may report a rounded one."""
        self._experiments[theta_key(theta)] = experiment
        while len(self._experiments) > _KEPT:
            self._experiments.popitem(last=False)

    def keep_failure(self, theta: Float[np.ndarray, " n"], error: Exception) -> None:
        """Keep the error of a θ that crashed or took too long, to avoid waiting for it twice."""
        self._failures[theta_key(theta)] = error

    def is_known(self, theta: Float[np.ndarray, " n"]) -> bool:
        """Return whether θ has run, with or without an experiment."""
        return theta_key(theta) in self._experiments or theta_key(theta) in self._failures

    def take_failure(self, theta: Float[np.ndarray, " n"]) -> Exception | None:
        """Return the error of θ and forget it, so that a retry runs θ again."""
        return self._failures.pop(theta_key(theta), None)

    def experiment(self, theta: Float[np.ndarray, " n"]) -> Experiment | None:
        """Return the experiment of θ; None if it has not run."""
        return self._experiments.get(theta_key(theta))


@dataclass(slots=True)
class Thoughts:
    """What questions are chosen from, and what likely answers would lead to."""

    simulator: Simulator | None = None
    """What the agent simulates with; None if it simulates nothing."""
    twin: Scenario | None = None
    """Model that θ are simulated on; None if that is the scenario itself."""
    prefetch: Prefetch = field(default_factory=Prefetch)
    basis: Basis | None = None
    """What the latest question was chosen from, by simulations."""
    about: History | None = None
    """The record whose next query is being chosen in the background."""

    def grounds(self, agent: Agent) -> Basis | None:
        """Return what the open question of `agent` was chosen from; None while it is not known."""
        basis = self.basis
        if basis is None or basis.past != past_of(agent):
            return None
        # The person may have asked for another challenger since.
        return basis if basis.pending == agent.history.pending else None

    def take(self, answer: Answer) -> None:
        """Go on with what was thought of the case that this answer is given."""
        if self.simulator is not None and self.prefetch.busy not in (None, answer):
            self.simulator.abandon()
        self.basis = self.prefetch.take(answer) or self.basis

    def resume(self) -> None:
        """Let simulations begin again."""
        if self.simulator is not None:
            self.simulator.resume()

    def make_way(self, history: History | None) -> None:
        """Abandon simulations unless they are for `history`, the record that is waited for."""
        if self.simulator is not None and self.about not in (None, history):
            self.about = None
            self.simulator.abandon()
