"""What the figures and the animation of an overtaking share: runs, colours, bodies."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from prefcal_env.experiment import Experiment
from prefcal_scenarios.report.record import Record
from prefcal_scenarios.report.style import BEST, FIRST, OTHERS

OBSTACLE = OTHERS[0]
ASPHALT, PAINT = "#eceff2", "#aab3bc"
DASH, PERIOD = 6.0, 12.0
"""Of the broken line between the lanes [m]."""


@dataclass(frozen=True, slots=True)
class Shown:
    """A run to draw, what it is called, and its colour."""

    experiment: Experiment
    label: str
    color: str


def best(record: Record) -> Shown:
    """The best run."""
    assert record.best is not None
    return Shown(record.best.experiment, f"best (experiment {record.best.number})", BEST)


def first(record: Record) -> Shown:
    """The first run."""
    trial = record.trials[0]
    return Shown(trial.experiment, f"first (experiment {trial.number})", FIRST)


def runs(record: Record) -> tuple[Shown, ...]:
    """The best run and the first one; once if they are the same."""
    assert record.best is not None
    if record.best.index == record.trials[0].index:
        return (best(record),)
    return best(record), first(record)


def windows(outline: Float[np.ndarray, "4 2"]) -> tuple[Float[np.ndarray, "4 2"], ...]:
    """Windscreen and rear window of a body with these corners."""
    left, back = outline[0] - outline[3], outline[1] - outline[0]
    shapes = (((0.27, 0.1), (0.27, 0.9), (0.42, 0.82), (0.42, 0.18)),
              ((0.88, 0.16), (0.88, 0.84), (0.79, 0.78), (0.79, 0.22)))  # fmt: skip
    return tuple(
        np.array([outline[3] + along * back + aside * left for along, aside in shape])
        for shape in shapes
    )
