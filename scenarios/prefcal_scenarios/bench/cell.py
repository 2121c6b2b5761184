"""One cell of the benchmark: which study is run."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Cell:
    """An agent on a problem before a calibrator, with a seed and a budget of experiments."""

    agent: str
    problem: str
    calibrator: str
    seed: int
    n_init: int = 10
    n_max: int = 50
