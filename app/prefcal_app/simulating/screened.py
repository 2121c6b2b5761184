"""Read what a question was chosen from, for people, and when to offer to stop."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from prefcal_agents.screening.certificate import MOST, Certificate
from prefcal_agents.screening.reason import Reason
from prefcal_agents.utility.bank import Bank
from prefcal_env.knobs.space import KnobSpace
from prefcal_scenarios.scenario import Scenario

from .basis import Basis, Carried
from .why import carried_by, kept, percent, robust, wanted

_UNLIKELY, _KNOWN = 0.1, 0.5
"""Chance below which stopping is offered, and that above which something better is known."""


@dataclass(frozen=True, slots=True)
class Prospect:
    """What the simulated θ are expected to gain.

    Args:
        simulated: Number of simulated θ.
        chance: Probability that the person prefers the most promising one to the best so far, by
            the draws alone.
        certificate: What can be said so that it holds for people unlike the draws; None while
            nothing can.
    """

    simulated: int
    chance: float
    certificate: Certificate | None = None

    @property
    def text(self) -> str:
        """Return whether something better can be expected."""
        said = self.certificate
        if said is not None and not said.explained:
            return "The KPIs do not explain the answers well enough to say how much better is left."
        if said is not None and said.share is not None and said.chance is not None:
            left = (
                f"Of θ drawn at random instead, fewer than {percent(said.share)} are noticeably better (with "
                f"{percent(said.probability)} probability).{_as_good_as(said)}"
            )
            return (
                f"The chance that the most promising of the {self.simulated} simulated is noticeably better "
                f"than the best so far is {percent(said.chance)}. "
                f"{left if said.share < 1 else 'It is too early to say how many of θ drawn at random are.'}"
            )
        return (
            f"The chance that the most promising of the {self.simulated} simulated is better than "
            f"the best so far is {percent(self.chance)}."
        )

    @property
    def offer(self) -> str:
        """Return the offer to stop; empty if there is a reason to continue."""
        chance = self.chance if self.certificate is None else self.certificate.chance
        return f"{self.text} Stop here, or go on?" if chance is not None and chance < _UNLIKELY else ""


def _as_good_as(said: Certificate) -> str:
    """Return how many random experiments the result is equal to, as a sentence after another one.

    Empty if something better is known: then it would read as a contradiction.
    """
    if said.experiments is None or said.chance is None or said.chance > _KNOWN:
        return ""
    low, middle, high = (
        f"{float(f'{n:.2g}'):,.0f}" if n < MOST else f"more than {MOST:,}" for n in said.experiments
    )
    about = middle if middle.startswith("more") else f"about {middle}"
    return f" The best so far is as good as the best of {about} random experiments (90 %: {low} to {high})."


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
        return Prospect(len(self.bank), self.basis.chance_of_better, self.basis.certificate)

    @property
    def told_result(self) -> bool:
        """Return whether it is worked out what carries the result of a study that is over."""
        carried = self.basis.carried
        return carried is not None and carried.over and carried.complete

    @property
    def carried(self) -> Carried | None:
        """Return what carries the result; None while not known, and if the KPIs do not explain answers."""
        certificate = self.basis.certificate
        return self.basis.carried if certificate is None or certificate.explained else None

    def result(self, scenario: Scenario) -> tuple[str, ...]:
        """Return how the result holds, what was wanted, what it rests on, and what need not change.

        Empty while not known.
        """
        found, carried = self.basis.carried, self.carried
        if found is None or not found.over:
            return ()
        told = () if found.robustness is None else tuple(robust(found.robustness, scenario))
        if carried is not None:
            told += wanted(carried.wishes, scenario), carried_by(carried.decisive)
            told += (kept(carried.smaller, scenario),)
        return tuple(filter(None, told))

    def row(self, theta: Float[np.ndarray, " n"]) -> int | None:
        """Return the row of the bank that a person cannot tell from θ, shape (n,); None if none.

        An equal one comes first: many θ are not rounded to the same last digits as a single one.
        """
        equal = np.all(self.bank.thetas == theta, axis=1)
        same = equal if equal.any() else self.space.close(theta, self.bank.thetas)
        return int(np.argmax(same)) if same.any() else None
