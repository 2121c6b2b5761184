"""Tell what happens during a run on a live plant, as frozen data."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum

from prefcal_env.experiments.experiment import Experiment

from .parts import Written


class Stage(Enum):
    """What a run on a live plant is doing."""

    CONNECTING = "connecting"
    WRITING = "writing the new values"
    WAITING = "waiting for the start condition"
    RECORDING = "recording"
    RESTORING = "restoring the old values"
    LOST = "connection lost: waiting to restore the old values"


@dataclass(frozen=True, slots=True)
class Change:
    """A value that is to be written.

    Args:
        part: Knob or start value, with its limits, rate and unit.
        old: Value on the plant now.
        new: Value to write.
    """

    part: Written
    old: float
    new: float

    @property
    def seconds(self) -> float:
        """Shortest duration of the change, in seconds."""
        return abs(self.new - self.old) / self.part.rate


@dataclass(frozen=True, slots=True)
class Progress:
    """How far a run is.

    Args:
        stage: What it is doing.
        elapsed: Recorded time so far, in seconds.
        duration: Longest time that is recorded, in seconds.
        values: Latest value of each tag by its key, "role name"; NaN for bad quality.
        problem: What went wrong so far, as a sentence; empty if nothing did.
    """

    stage: Stage
    elapsed: float
    duration: float
    values: Mapping[str, float] = field(default_factory=dict)
    problem: str = ""


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
