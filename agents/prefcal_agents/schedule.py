"""Which kind of proposal comes when: each is led astray by functions of its own."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Turn:
    """What one proposal minimises.

    Args:
        process: The mean of a Gaussian process in place of the acquisition.
        rough: Of a process whose values jump a little from sample to sample.
        perturbed: Margins drawn at random, and no exploration.
    """

    process: bool = False
    rough: bool = False
    perturbed: bool = False


def turn_of(index: int, *, process: bool, perturb_every: int) -> Turn:
    """The turn of proposal number `index`, counted from 0 after the initial samples.

    Source: none; the paper minimises one acquisition at every step.
    Deviation: one kind of proposal keeps returning to the same place when it is wrong. Every
    second one is the process's, if it takes turns at all, and every second of these is rough.

    Args:
        index: 0 or more.
        process: Whether the process takes turns.
        perturb_every: Every how many of the other proposals the margins are drawn at random; 0:
            never.
    """
    if process and index % 2:
        return Turn(process=True, rough=index % 4 == 3)
    other = index // 2 if process else index
    return Turn(perturbed=perturb_every > 0 and other % perturb_every == 0)
