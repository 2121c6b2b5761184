"""Say what the simulated θ still promise, and when to offer to stop."""

from dataclasses import dataclass

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
