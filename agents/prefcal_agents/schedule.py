"""What comes when: kinds of proposals (each is led astray by functions of its own), validations."""

from dataclasses import dataclass

FEW = 20
"""Experiments; before that many the process takes no turns."""
MANY = 100
"""Experiments or comparisons; beyond, the shape of φ hardly moves and takes long."""
SELDOM = 10
"""Experiments between two validations, or two doubts, then."""


@dataclass(frozen=True, slots=True)
class Turn:
    """What one proposal minimises.

    Args:
        process: The mean of a Gaussian process in place of the acquisition.
        perturbed: Margins drawn at random, and no exploration.
    """

    process: bool = False
    perturbed: bool = False


def turn_of(answered: int, n_init: int, *, process: bool, perturb_every: int) -> Turn:
    """The turn of the proposal after `answered` experiments, `n_init` or more.

    Source: none; the paper minimises one acquisition at every step.
    Deviation: one kind of proposal keeps returning to the same place when it is wrong. From
    `FEW` experiments on every second one is the process's, if it takes turns at all. Before that
    it settles too soon on one of many valleys.

    Args:
        answered: How many experiments are compared.
        n_init: How many of them were samples of the start.
        process: Whether the process takes turns.
        perturb_every: Every how many of the other proposals the margins are drawn at random; 0:
            never.
    """
    since = answered - max(n_init, FEW)
    if process and since >= 0 and since % 2:
        return Turn(process=True)
    other = answered - n_init - (process_turns(answered, n_init) if process else 0)
    return Turn(perturbed=perturb_every > 0 and other % perturb_every == 0)


def process_turns(answered: int, n_init: int) -> int:
    """How many proposals before the one after `answered` experiments were the process's."""
    return max(0, answered - max(n_init, FEW)) // 2
