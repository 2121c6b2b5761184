"""Which kind of proposal comes when: each is led astray by functions of its own."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Turn:
    """What one proposal minimises, and where.

    Args:
        kernel: The surrogate of least kernel norm in place of that of least weights.
        perturbed: Margins drawn at random, and no exploration.
        local: Within the trust region round the incumbent only.
    """

    kernel: bool
    perturbed: bool
    local: bool


def turn_of(index: int, *, kernel: bool, perturb_every: int, local: bool) -> Turn:
    """The turn of proposal number `index`, counted from 0 after the initial samples.

    Source: none; the paper minimises one acquisition over the whole box at every step.
    Deviation: one kind of proposal keeps returning to the same place when it is wrong. They go
    round in fours: the second and third are the kernel's, the third and fourth local, so with
    every second one perturbed no two of the four are alike.

    Args:
        index: 0 or more.
        kernel: Whether the surrogate of least kernel norm takes turns at all.
        perturb_every: Every how many proposals the margins are drawn at random; 0: never.
        local: Whether there is a trust region at all.
    """
    quarter = index % 4
    return Turn(
        kernel=kernel and quarter in (1, 2),
        perturbed=perturb_every > 0 and index % perturb_every == 0,
        local=local and quarter in (2, 3),
    )
