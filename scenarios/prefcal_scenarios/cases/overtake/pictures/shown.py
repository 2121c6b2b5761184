"""Choose the runs that figures and animation of an overtaking show, and their colors."""

from dataclasses import dataclass

from prefcal_env.experiments.experiment import Experiment
from prefcal_scenarios.app.presentation.style import BEST, FIRST, OTHERS
from prefcal_scenarios.app.report.record import Record

OBSTACLE = OTHERS[0]


@dataclass(frozen=True, slots=True)
class Shown:
    """A run to draw, its label and its color."""

    experiment: Experiment
    label: str
    color: str


def best(record: Record) -> Shown:
    """Return the best run."""
    assert record.best is not None
    return Shown(record.best.experiment, f"best (experiment {record.best.number})", BEST)


def first(record: Record) -> Shown:
    """Return the run that the best one is compared with."""
    trial = record.before
    return Shown(trial.experiment, f"{record.baseline.name} ({trial.number})", FIRST)


def runs(record: Record) -> tuple[Shown, ...]:
    """Return the best run and the one before; one run if they are the same."""
    assert record.best is not None
    if record.best.index == record.before.index:
        return (best(record),)
    return best(record), first(record)
