"""Read what a question was chosen from, for people, and when to offer to stop."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from prefcal_agents.screening.reason import Reason
from prefcal_agents.utility.bank import Bank
from prefcal_app.simulating import Basis
from prefcal_env.knobs.space import KnobSpace

_UNLIKELY = 0.1
"""Chance below which stopping is offered."""


@dataclass(frozen=True, slots=True)
class Prospect:
    """What the simulated θ are expected to gain.

    Args:
        simulated: Number of simulated θ.
        chance: Probability that the person prefers the most promising one to the best so far.
    """

    simulated: int
    chance: float

    @property
    def text(self) -> str:
        """Return in one sentence whether something better can be expected."""
        return (
            f"The chance that the most promising of the {self.simulated} simulated is better than "
            f"the best so far is {percent(self.chance)}."
        )

    @property
    def offer(self) -> str:
        """Return the offer to stop; empty if there is a reason to continue."""
        return f"{self.text} Stop here, or go on?" if self.chance < _UNLIKELY else ""


def percent(chance: float) -> str:
    """Return a probability as text: nothing that a model says is sure."""
    if chance < 0.01:
        return "below 1 %"
    if chance > 0.99:
        return "above 99 %"
    return f"{100 * chance:.0f} %"


@dataclass(frozen=True, eq=False, slots=True)
class Screened:
    """What a screening agent knows after a record.

    Args:
        space: Knobs of the study.
        basis: What the open question was chosen from, or what is known after the last one.
    """

    space: KnobSpace
    basis: Basis

    @property
    def bank(self) -> Bank:
        """Return the simulated θ with their KPIs."""
        return self.basis.bank

    @property
    def reason(self) -> Reason | None:
        """Return why the challenger of the open question is shown; None without a comparison."""
        return self.basis.reason

    @property
    def prospect(self) -> Prospect | None:
        """Return what the simulated θ still promise; None before an answer that teaches."""
        if not self.basis.past.lessons():
            return None
        return Prospect(len(self.bank), self.basis.chance_of_better)

    def row(self, theta: Float[np.ndarray, " n"]) -> int | None:
        """Return the row of the bank that a person cannot tell from θ, shape (n,); None if none.

        An equal one comes first: many θ are not rounded to the same last digits as a single one.
        """
        equal = np.all(self.bank.thetas == theta, axis=1)
        same = equal if equal.any() else self.space.close(theta, self.bank.thetas)
        return int(np.argmax(same)) if same.any() else None
