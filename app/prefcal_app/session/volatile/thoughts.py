"""Hold what the agent thinks of in advance; it can be lost at any time without changing a result."""

from dataclasses import dataclass, field

from prefcal_agents.protocol.agent import Agent
from prefcal_app.simulating import Basis, Simulator, past_of
from prefcal_env.preferences.answer import Answer
from prefcal_env.preferences.history import History
from prefcal_scenarios.scenario import Scenario

from .prefetch import Prefetch


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
