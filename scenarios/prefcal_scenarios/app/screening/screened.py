"""Read from a screening agent what a person is told about it."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from prefcal_agents.protocol.agent import Agent
from prefcal_agents.screening.agent import Screening
from prefcal_agents.screening.bank import Bank
from prefcal_agents.screening.reason import Reason
from prefcal_env.errors import SettingsError
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.preferences.history import History

from .prospect import Prospect


@dataclass(frozen=True, eq=False, slots=True)
class Screened:
    """What a screening agent knows after a record.

    Args:
        space: Knobs of the study.
        bank: Simulated θ with their KPIs.
        reason: Why the challenger of the open query is shown; None without a comparison.
        chance: Probability that the most promising simulated θ is preferred to the best so far.
        history: The record, with the sample of the open query.
    """

    space: KnobSpace
    bank: Bank
    reason: Reason | None
    chance: float
    history: History

    def is_about(self, history: History) -> bool:
        """Return whether it was read after this record of an agent."""
        return self.history is history or self.history == history

    @property
    def prospect(self) -> Prospect | None:
        """Return what the simulated θ still promise; None before an answer that teaches."""
        if not self.history.lessons():
            return None
        return Prospect(len(self.bank), self.chance)

    def row(self, theta: Float[np.ndarray, " n"]) -> int | None:
        """Return the row of the bank that a person cannot tell from θ, shape (n,); None if none.

        An equal one comes first: many θ are not rounded to the same last digits as a single one.
        """
        equal = np.all(self.bank.thetas == theta, axis=1)
        same = equal if equal.any() else self.space.close(theta, self.bank.thetas)
        return int(np.argmax(same)) if same.any() else None


def screened_of(agent: Agent) -> Screened | None:
    """Return what a screening agent knows; None for others, and for one that cannot simulate.

    It may take long: the agent simulates whatever it needs for its open query.
    """
    if not isinstance(agent, Screening):
        return None
    history = agent.history
    try:
        bank = agent.bank
    except SettingsError:  # restored, and not given its simulations yet
        return None
    reason = None if agent.done else agent.reason
    return Screened(agent.space, bank, reason, agent.chance_of_better, history)
