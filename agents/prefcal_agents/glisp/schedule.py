"""Decide which proposals the Gaussian process makes, and how often shapes are validated."""

FEW = 20
"""Number of experiments before the process takes turns."""
MANY = 100
"""Number of experiments or comparisons beyond which the shape of φ hardly moves and takes long."""
SELDOM = 10
"""Number of experiments between two validations, or two noise tests, from then on."""


def is_process_turn(answered: int, n_init: int) -> bool:
    """Return whether the process makes the proposal after `answered` experiments.

    Source: none; the paper minimizes one acquisition at every step.
    Deviation: one kind of proposal keeps returning to the same place when it is wrong, so from
    `FEW` experiments on every second proposal is the process's. Before that the process settles
    too soon on one of many valleys.

    Args:
        answered: Number of answered experiments, `n_init` or more.
        n_init: Number of experiments in the initial design.
    """
    since = answered - max(n_init, FEW)
    return since >= 0 and since % 2 == 1


def process_turns(answered: int, n_init: int) -> int:
    """Return how many proposals before the one after `answered` experiments were the process's."""
    return max(0, answered - max(n_init, FEW)) // 2
