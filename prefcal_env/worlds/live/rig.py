"""A live plant that prefcal drives itself, after a person confirmed what is written."""

import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from math import isfinite
from typing import Any, Literal

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import LiveError, SettingsError
from prefcal_env.experiments.experiment import Channel, Channels, Experiment
from prefcal_env.experiments.tracking import tracking_kpis
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.sources.run import Change
from prefcal_env.sources.source import KPIsOf, Source, formula_problems, with_own

from .drive import Drive, Hands
from .journal import Journal
from .parts import LiveKnob, LiveStart, Tag
from .plant import LivePlant
from .progress import Confirm, Driven, Tell
from .run import LiveRun, RestoringRun

Limits = Mapping[str, tuple[float, float]]


@dataclass(frozen=True)
class LiveRig(Source):
    """The `run` of a scenario whose experiments prefcal does on a live plant.

    A run writes θ at limited rates and reads it back, waits for the start condition, writes the
    start values, records, and restores the old values: after a completed run, when it is stopped or
    crosses an abort limit, and after a lost connection as soon as it is regained. The old values
    are on the disk before the first write, so that a later start restores them after a crash.

    Args:
        plant: Connection to the plant.
        knobs: Knobs, in the order of θ.
        tags: Nodes that are recorded; at least one output.
        duration: Longest recorded time, in seconds.
        period: Sampling period in seconds.
        start: Values that start a run, for example a set-point; they are always taken back.
        ready: Maps outputs or inputs to limits in which they must be before the start.
        ready_within: Longest wait for that, in seconds.
        done: Maps outputs or inputs to limits in which the run ends early; by default, it never
            does.
        hold: Time, in seconds, for which the conditions must hold.
        blind: Longest time, in seconds, for which a value with an abort limit may have bad quality.
        after: "restore" to take θ back after a completed run, "keep" to leave it on the plant.
        journal: File for the old values; by default, one per plant in the user's data folder.
        instructions: What a person must check before they confirm.
        kpis: Function that returns the KPIs of an experiment by name.

    Raises:
        SettingsError: If names or nodes repeat, there is no output, or a number is not valid.
    """

    plant: LivePlant
    knobs: tuple[LiveKnob, ...]
    tags: tuple[Tag, ...]
    duration: float = field()
    period: float = 1.0
    start: tuple[LiveStart, ...] = ()
    ready: Limits = field(default_factory=dict)
    ready_within: float = 600.0
    done: Limits = field(default_factory=dict)
    hold: float = 0.0
    blind: float = 5.0
    after: Literal["restore", "keep"] = "restore"
    journal: Journal | None = None
    instructions: str = ""
    kpis: Callable[[Experiment], Mapping[str, float]] = tracking_kpis

    asks = "confirm"
    stops = recovers = True
    channels: Channels = field(init=False, repr=False, compare=False)
    """Channels of its experiments; those in `y` are the outputs with a recorded reference."""

    def __post_init__(self) -> None:
        for name in ("knobs", "tags", "start"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        if not self.knobs or not any(tag.role == "output" for tag in self.tags):
            raise SettingsError("a live rig needs a knob to write and an output to record")
        self._check_names()
        for name, least in (("period", 0.0), ("duration", self.period), ("ready_within", 0.0)):
            value = getattr(self, name)
            if not (isfinite(value) and value > least):
                raise SettingsError(f"{name} must be above {least:g} s, got {value}")
        for name in ("hold", "blind"):
            value = getattr(self, name)
            if not (isfinite(value) and value >= 0):
                raise SettingsError(f"{name} must be 0 s or more, got {value}")
        if self.after not in ("restore", "keep"):
            raise SettingsError(f"after must be restore or keep, got {self.after!r}")
        self.keyed(self.ready), self.keyed(self.done)
        object.__setattr__(self, "channels", self._channels())
        kept = "the old values are restored" if self.after == "restore" else "the new θ stays"
        object.__setattr__(self, "afterward", kept)

    def _check_names(self) -> None:
        written = (*self.knobs, *self.start)
        for what, found in (
            ("name of a knob or start value", [w.knob.name for w in written]),
            ("node that is written to", [w.node for w in written]),
            ("output or input", [tag.name for tag in self.tags if tag.role != "reference"]),
            ("reference", [tag.name for tag in self.tags if tag.role == "reference"]),
        ):
            twice = sorted({each for each in found if found.count(each) > 1})
            if twice:
                raise SettingsError(f"each {what} may be given once, got {twice[0]!r} twice")
        outputs = {tag.name for tag in self.tags if tag.role == "output"}
        for tag in self.tags:
            if tag.role == "reference" and tag.name not in outputs:
                raise SettingsError(
                    f"a reference must have the name of an output, {sorted(outputs)}, got {tag.name!r}"
                )

    @property
    def space(self) -> KnobSpace:
        """Space of the knobs."""
        return KnobSpace([live.knob for live in self.knobs])

    def _channels(self) -> Channels:
        """Return the channels; those in `y` are the outputs with a recorded reference."""
        by_role = {
            role: tuple(Channel(t.name, t.unit, t.low, t.high) for t in self.tags if t.role == role)
            for role in ("output", "input")
        }
        aimed = {tag.name for tag in self.tags if tag.role == "reference"}
        y = tuple(channel for channel in by_role["output"] if channel.name in aimed)
        return Channels((), by_role["input"], y)

    def begin(self, theta: Float[np.ndarray, " n"], seed: int = 0) -> LiveRun:
        """Return a run of θ, physical, shape (n,), that asks for a confirmation before it writes."""
        return LiveRun(self, theta)

    def recovery(self) -> RestoringRun:
        """Return the run that restores what an interrupted one left."""
        return RestoringRun(self)

    def close(self) -> None:
        """Close the connection to the plant."""
        self.plant.close()

    def look(
        self, theta: Float[np.ndarray, " n"], *, clock: Callable[[], float] = time.monotonic
    ) -> tuple[Change, ...]:
        """Return what a run of θ, physical, shape (n,), would write; nothing is written.

        Raises:
            KnobError: If θ is outside the knobs' ranges.
            LiveError: If the plant cannot be reached, or has a value outside the limits.
        """
        return self._drive(theta, Hands(clock, lambda seconds: None)).look()

    def drive(
        self,
        theta: Float[np.ndarray, " n"],
        confirm: Confirm,
        *,
        stop: Callable[[], bool] = lambda: False,
        closing: Callable[[], bool] = lambda: False,
        tell: Tell = lambda progress: None,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> Driven:
        """Run θ on the plant and return what was recorded.

        Args:
            theta: Physical θ, shape (n,).
            confirm: Function that shows a person the changes and returns whether they confirm
                them. Without their consent, nothing is written.
            stop: Function that returns whether to stop the run and restore the old values.
            closing: Function that returns whether the process has been told to end. Then a lost
                plant is waited for only briefly; its old values are restored at the next start.
            tell: Function that is called after every sample.
            clock: Function that returns the time in seconds.
            sleep: Function that waits for a number of seconds.

        Raises:
            KnobError: If θ is outside the knobs' ranges.
            LiveError: If another process runs on the plant, or an earlier run's values cannot be
                restored. What happens during the run is data: see `Driven.why`.
        """
        hands = Hands(clock, sleep, confirm, stop, closing, tell)
        drive = self._drive(theta, hands)
        with self._kept.alone():
            self._recover(drive)
            return drive.run()

    def measured(self, kpis_of: KPIsOf) -> "LiveRig":
        """Return the same rig, whose experiments have more KPIs than their own."""
        return replace(self, kpis=with_own(self.kpis, kpis_of(self.channels)))

    def problems(self, kpis: Iterable[Any]) -> Iterator[str]:
        """Yield which formulas of KPIs name what is not recorded, before a run is spent on it."""
        outputs = tuple(tag for tag in self.tags if tag.role == "output")
        yield from formula_problems(kpis, replace(self.channels, x=outputs), ())

    @property
    def left(self) -> dict[str, float] | None:
        """Old values, by name, that an interrupted run left to be restored; None if none are.

        Raises:
            LiveError: If their file is damaged.
        """
        return self._kept.load()

    def recover(
        self,
        *,
        closing: Callable[[], bool] = lambda: False,
        tell: Tell = lambda progress: None,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> bool:
        """Restore what an interrupted run left; return whether there was anything.

        Raises:
            LiveError: If another process runs on the plant, or it refuses its old values.
        """
        middle = self.space.decode(np.full(len(self.knobs), 0.5))
        hands = Hands(clock, sleep, closing=closing, tell=tell)
        with self._kept.alone():
            return self._recover(self._drive(middle, hands))

    def _recover(self, drive: Drive) -> bool:
        old = self._kept.load()
        if old is None:
            return False
        strangers = sorted(set(old) - set(drive.written))
        if strangers:
            values = ", ".join(f"{name} = {old[name]:g}" for name in strangers)
            raise LiveError(
                f"an interrupted run changed {values}, which this rig does not write: restore it "
                f"by hand, then remove {self._kept.path}"
            )
        if not drive.restore(old):
            raise LiveError(f"the values from before an interrupted run are not restored: {drive.problem}")
        return True

    @property
    def _kept(self) -> Journal:
        return self.journal or Journal.of(self.plant.address)

    def _drive(self, theta: Float[np.ndarray, " n"], hands: Hands) -> Drive:
        values = dict(zip(self.space.names, self.space.check(theta).tolist(), strict=True))
        return Drive(self, values, self._kept, hands)

    def keyed(self, limits: Limits) -> dict[str, tuple[float, float]]:
        """Return conditions by the key of their tag."""
        found = {tag.name: tag.key for tag in self.tags if tag.role != "reference"}
        for name, (low, high) in limits.items():
            if name not in found or not low < high:
                raise SettingsError(
                    f"a condition must give low < high of one of {sorted(found)}, got {name!r}: {low}, {high}"
                )
        return {found[name]: (float(low), float(high)) for name, (low, high) in limits.items()}
