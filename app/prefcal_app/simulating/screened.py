"""Read what a question was chosen from, for people."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from prefcal_agents.screening.reason import Reason
from prefcal_agents.utility.bank import Bank
from prefcal_app.simulating import Basis
from prefcal_env.knobs.space import KnobSpace

from .prospect import Prospect


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
