"""A run is one experiment under way: what it asks of a person, and how far it is."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from math import inf, nan

from prefcal_env.errors import ScenarioError
from prefcal_env.experiments.experiment import Channel, Experiment
from prefcal_env.knobs.knob import Knob


class Stage(Enum):
    """What a run on a plant is doing."""

    CONNECTING = "connecting"
    WRITING = "writing the new values"
    WAITING = "waiting for the start condition"
    RECORDING = "recording"
    RESTORING = "restoring the old values"
    LOST = "connection lost: waiting to restore the old values"


@dataclass(frozen=True, slots=True)
class Progress:
    """How far a run is.

    Args:
        stage: What it is doing.
        elapsed: Recorded time so far, in seconds.
        duration: Longest time that is recorded, in seconds.
        values: Latest values by "role name", such as "output level"; NaN for bad quality.
        problem: What went wrong so far, as a sentence; empty if nothing did.
    """

    stage: Stage
    elapsed: float
    duration: float
    values: Mapping[str, float] = field(default_factory=dict)
    problem: str = ""


@dataclass(frozen=True, slots=True)
class Change:
    """A value that a run is to write to a plant, for a person to confirm.

    Args:
        quantity: What has the value, with the limits of what may be written: a knob, for example.
        new: Value to write, in the unit of `quantity`.
        old: Value on the plant now; NaN if it is not known.
        rate: Largest rate of change, in the unit of `quantity` per second.
    """

    quantity: Knob | Channel
    new: float
    old: float = nan
    rate: float = inf

    @property
    def name(self) -> str:
        """Name of the quantity."""
        return self.quantity.name

    @property
    def unit(self) -> str:
        """Unit of the values."""
        return self.quantity.unit

    @property
    def seconds(self) -> float:
        """Shortest duration of the change, in seconds."""
        return abs(self.new - self.old) / self.rate


@dataclass(frozen=True, slots=True)
class RunCurve:
    """An output that is recorded, as far as it is known.

    Args:
        channel: Channel of the output.
        values: Values at the recorded instants; NaN for bad quality.
        reference: Values of its reference; empty if it has none.
    """

    channel: Channel
    values: tuple[float, ...]
    reference: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True)
class Table:
    """A record that a person supplies.

    Args:
        content: Content of a file.
        unsafe: Whether the run became unsafe and was stopped.
    """

    content: bytes
    unsafe: bool = False


Given = Table | tuple[Change, ...]
"""What a person supplies: a record, or the changes that they confirm."""


class Run:
    """One experiment under way. One thread advances it; any may look at it, supply it or stop it.

    Attributes:
        waits: Whether a person must supply something before the run can be advanced.
        moves_plant: Whether a plant is being changed, so that nothing else may be done meanwhile.
        stopping: Whether the run was told to stop.
        progress: How far the run is; None if that is not known.
        changed: Function that is called, from the thread of the run, when there is news.
        changes: What would be written to a plant, for a person to confirm; None if that is not
            known or nothing is.
        problem: Why the run waits, or what remains to be done after it, as a sentence.
        partial: What was recorded before the run failed; None if nothing was.
    """

    waits: bool = False
    moves_plant: bool = False
    stopping: bool = False
    progress: Progress | None = None
    changed: Callable[[], None] = staticmethod(lambda: None)
    changes: tuple[Change, ...] | None = None
    problem: str = ""
    partial: Experiment | None = None

    @property
    def recorded(self) -> tuple[tuple[float, ...], tuple[RunCurve, ...]]:
        """Return instants in seconds, and the curves recorded so far."""
        return (), ()

    def advance(self) -> Experiment | None:
        """Do the next part of the run, however long it takes; return its experiment at the end.

        Raises:
            Exception: If there is no experiment: whatever the user's code raised, or a RunError.
        """
        raise NotImplementedError

    def supply(self, given: Given) -> None:
        """Supply what the run asks for: a record, or the changes that a person confirms."""
        raise ScenarioError("this run asks for nothing")

    def stop(self, why: str, within: float = 0.0) -> None:
        """Stop the run in `within` seconds, if it can be: "stopped" by a person, or "given up"."""


class Whole(Run):
    """A run that a single call does from its start to its end."""

    def __init__(self, run: Callable[[], Experiment]) -> None:
        self._run = run

    def advance(self) -> Experiment:
        """Return the experiment. Raises whatever the call raises."""
        return self._run()
