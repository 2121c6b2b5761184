"""What is kept of one cell of the benchmark."""

from dataclasses import dataclass

from prefcal_scenarios.bench.cell import Cell


@dataclass(frozen=True, slots=True)
class Result:
    """What became of one cell.

    Args:
        cell: Which study.
        thetas: What was tried, physical, in order.
        gaps: Noise-free latent cost, minus the best known, of what the agent would have returned
            after experiment i+1; None where the problem has no cost.
        visited: The same of the best point visited by then.
        questions: Questions asked by then.
        best: θ that the agent returned, physical.
        failure: Why the cell failed, in words; empty if it did not. A failed cell has no numbers.
        seconds: Of a proposal, where it was measured: in serial runs only.
    """

    cell: Cell
    thetas: tuple[tuple[float, ...], ...]
    gaps: tuple[float, ...] | None
    visited: tuple[float, ...] | None
    questions: tuple[int, ...]
    best: tuple[float, ...]
    failure: str = ""
    seconds: float | None = None
