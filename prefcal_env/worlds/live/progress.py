"""Tell what happens during a run on a live plant, as frozen data."""

from collections.abc import Callable
from dataclasses import dataclass

from prefcal_env.experiments.experiment import Experiment
from prefcal_env.sources.run import Change, Progress


@dataclass(frozen=True, slots=True)
class Driven:
    """Result of a run on a live plant.

    Args:
        experiment: What was recorded. It ended as failed if the run was stopped, refused or lost.
        why: What stopped the run, as a sentence; empty if it was completed.
        restored: Whether the plant has its old values again. False if they are kept on purpose,
            or if the plant could not be reached or refused them.
        stopped: Whether a person stopped the run, or did not confirm it.
        kept: Whether the knobs keep their new values on purpose; the start values are taken back.
        problem: Why the plant does not have the values that it should have; empty if it has.
    """

    experiment: Experiment
    why: str = ""
    restored: bool = True
    stopped: bool = False
    kept: bool = False
    problem: str = ""


Confirm = Callable[[tuple[Change, ...]], bool]
"""Function that shows a person what will be written and returns whether they confirm it."""
Tell = Callable[[Progress], None]
"""Function that is called after every sample."""
