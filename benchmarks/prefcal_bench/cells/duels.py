"""Duels: compare the results of two agents on problems without a cost."""

import hashlib
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import combinations

import numpy as np

from prefcal_bench.problems import prefer, problem
from prefcal_env.errors import SettingsError

from .cell import FORMAT, Result, Theta, canonical
from .run import alone

PAPER = "the paper's optimum"  # name of the rival that is not an agent


@dataclass(frozen=True, slots=True, order=True)
class Duel:
    """Noise-free verdict on the results of `agent` and `rival` with the same seed.

    Args:
        problem: Name of a problem without a cost.
        calibrator: Name of the calibrator that answered in the studies.
        agent: Name of the agent.
        rival: Name of another agent, or `PAPER`.
        seed: Seed of both studies.
        outcome: -1 if the agent's θ is preferred, 0 for a tie, 1 if the rival's is.
    """

    problem: str
    calibrator: str
    agent: str
    rival: str
    seed: int
    outcome: int

    def __post_init__(self) -> None:
        if self.outcome not in (-1, 0, 1):
            raise SettingsError(f"outcome of a duel must be -1, 0 or 1, got {self.outcome!r}")


@dataclass(frozen=True, slots=True)
class Round:
    """Results of all agents with one seed, compared pairwise and with the paper's optimum."""

    problem: str  # name of a problem without a cost
    calibrator: str  # name of the calibrator that answered
    seed: int  # seed of the studies
    thetas: tuple[tuple[str, Theta], ...]  # physical θ that each agent returned

    @property
    def key(self) -> str:
        """Return the sha256 in hex of the round and of the version of its problem."""
        content = [FORMAT, problem(self.problem).version, asdict(self)]
        return hashlib.sha256(canonical(content).encode()).hexdigest()


def rounds(results: Sequence[Result]) -> tuple[Round, ...]:
    """Return the rounds to play in canonical order, from successful results without a cost.

    Raises:
        SettingsError: If results of one study have different numbers of experiments.
    """
    groups: dict[tuple[str, str, int], dict[str, Theta]] = {}
    for result in sorted(results, key=lambda result: result.cell):
        cell = result.cell
        if result.failure or result.gaps is not None or result.worth is not None:
            continue
        group = groups.setdefault((cell.problem, cell.calibrator, cell.seed), {})
        if cell.agent in group:
            raise SettingsError(f"there are two results of {cell}: duels need one budget")
        group[cell.agent] = result.best
    return tuple(Round(*study, tuple(group.items())) for study, group in sorted(groups.items()))


def play(round_: Round) -> tuple[Duel, ...]:
    """Compare all pairs of a round by the referee, which is never wrong."""
    where = problem(round_.problem)
    referee = where.referee
    assert referee is not None  # there is one wherever there are calibrators
    thetas = {name: np.array(theta) for name, theta in round_.thetas}
    if where.paper is not None:
        thetas[PAPER] = where.paper
    with alone():
        outcomes = {name: where.outcome(theta) for name, theta in thetas.items()}
    return tuple(
        Duel(
            round_.problem,
            round_.calibrator,
            agent,
            rival,
            round_.seed,
            int(prefer(referee, outcomes[agent], outcomes[rival])),
        )
        for agent, rival in combinations(outcomes, 2)
    )
