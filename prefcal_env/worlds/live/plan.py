"""Declare what a run on a live plant does, and check it before anything is written."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from math import isfinite
from typing import Literal

from prefcal_env.errors import SettingsError
from prefcal_env.experiments.experiment import Channel, Channels, Experiment
from prefcal_env.experiments.tracking import tracking_kpis
from prefcal_env.knobs.space import KnobSpace

from .journal import Journal
from .parts import LiveKnob, LiveStart, Tag
from .plant import LivePlant

Limits = Mapping[str, tuple[float, float]]


@dataclass(frozen=True)
class LivePlan:
    """What a `LiveRig` is made of, which says what each argument means.

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

    def keyed(self, limits: Limits) -> dict[str, tuple[float, float]]:
        """Return conditions by the key of their tag."""
        found = {tag.name: tag.key for tag in self.tags if tag.role != "reference"}
        for name, (low, high) in limits.items():
            if name not in found or not low < high:
                raise SettingsError(
                    f"a condition must give low < high of one of {sorted(found)}, got {name!r}: {low}, {high}"
                )
        return {found[name]: (float(low), float(high)) for name, (low, high) in limits.items()}
