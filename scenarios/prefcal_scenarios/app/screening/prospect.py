"""Say what the simulated θ still promise, and when to offer to stop."""

from dataclasses import dataclass

_UNLIKELY = 0.15
"""Chance below which nothing simulated is expected to be preferred."""


@dataclass(frozen=True, slots=True)
class Prospect:
    """What the simulated θ are expected to gain.

    Args:
        simulated: Number of simulated θ.
        chance: Probability that the most promising one is preferred to the best so far, 0 to 1.
    """

    simulated: int
    chance: float

    @property
    def stop(self) -> bool:
        """Return whether nothing that was simulated is expected to be preferred."""
        return self.chance < _UNLIKELY

    @property
    def text(self) -> str:
        """Return in one sentence whether something better can be expected."""
        chance = percent(self.chance)
        if self.stop:
            return (
                f"Nothing among the {self.simulated} simulated is expected to be preferred to the "
                f"best so far (chance of the most promising: {chance})."
            )
        return (
            f"The most promising of the {self.simulated} simulated is preferred to the best so far "
            f"with a chance of {chance}."
        )

    @property
    def offer(self) -> str:
        """Return the offer to stop; empty if there is a reason to continue."""
        return f"{self.text} Stop here, or go on?" if self.stop else ""


def percent(chance: float) -> str:
    """Return a probability as text; only what is sure reads 0 or 100 %."""
    if 0 < chance < 0.01:
        return "less than 1 %"
    if 0.99 < chance < 1:
        return "more than 99 %"
    return f"{100 * chance:.0f} %"
