"""Why a screening agent shows this experiment, as data that front ends put into words."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Reason:
    """Why the challenger of the open query is shown.

    Args:
        chance: Probability that the person prefers it to the best so far, by what was learned.
        better_in: Names of the KPIs in which it is better than the best so far, the one that
            matters most first.
        worse_in: Names of those in which it is worse, likewise.
        learned: Names of the KPIs that count more, by the answers, than before the first answer,
            the clearest first; empty before anything is learned.
    """

    chance: float
    better_in: tuple[str, ...]
    worse_in: tuple[str, ...]
    learned: tuple[str, ...]
