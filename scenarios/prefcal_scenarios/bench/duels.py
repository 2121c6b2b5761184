"""Duels: what two agents returned, held against each other where there is no cost."""

from dataclasses import dataclass

PAPER = "the paper's optimum"
"""The rival that is no agent."""


@dataclass(frozen=True, slots=True)
class Duel:
    """The noise-free verdict on what `agent` and `rival` returned with the same seed.

    Args:
        problem: One without a cost.
        calibrator: The one that the studies were answered by.
        agent: Its name.
        rival: Another agent's name, or `PAPER`.
        seed: Of both studies.
        outcome: -1 the agent's is preferred, 0 a tie, 1 the rival's.
    """

    problem: str
    calibrator: str
    agent: str
    rival: str
    seed: int
    outcome: int
