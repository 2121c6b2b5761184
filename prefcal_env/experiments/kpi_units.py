"""Kinds of the generic KPIs of tracking: their names, meanings and units."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class TrackingKind:
    """One kind of KPI that each output with a reference, or each input, has.

    Args:
        name: Name of the kind; the KPI of a channel is called "NAME of CHANNEL".
        about: Meaning, as shown to people.
        unit: Unit, where {unit} is that of the channel and {time} that of time.
    """

    name: str
    about: str
    unit: str = "{unit}"

    def of(self, channel: Any) -> str:
        """Return the name of the KPI of a channel."""
        return f"{self.name} of {channel.name}"

    def unit_of(self, channel: Any, time_unit: str) -> str:
        """Return the unit of the KPI of a channel."""
        return self.unit.format(unit=channel.unit, time=time_unit).strip()


OF_OUTPUT = (
    TrackingKind("integrated error", "Area between the curve and its reference.", "{unit} {time}"),
    TrackingKind(
        "late error", "Area between the curve and its reference, weighted with time.", "{unit} {time}²"
    ),
    TrackingKind("settling time", "Time of the last entry into the band around the reference.", "{time}"),
    TrackingKind("overshoot", "Largest distance beyond the reference, on the other side than the start."),
    TrackingKind("final error", "Distance from the reference at the end."),
)
"""Kinds of each output with a reference, in the order in which `tracking_kpis` computes them."""
OF_INPUT = (
    TrackingKind("total move", "Sum of all changes of the input: how much the actuator works."),
    TrackingKind("largest move", "Largest change of the input from one instant to the next."),
    TrackingKind("RMS move", "Root mean square of the changes of the input."),
)
"""Kinds of each input, likewise."""


def kinds_of(channels: Any) -> Iterable[tuple[TrackingKind, Any]]:
    """Yield each kind with each of the `Channels` that has it, as if all outputs had references."""
    for kinds, group in ((OF_OUTPUT, channels.y), (OF_INPUT, channels.u)):
        for channel in group:
            yield from ((kind, channel) for kind in kinds)


def with_units(kpis: Mapping[str, float], channels: Any) -> Iterable[tuple[str, str]]:
    """Yield the name of each KPI, and its value with its unit if the channels tell that."""
    time = channels.time_unit
    units = {kind.of(channel): kind.unit_of(channel, time) for kind, channel in kinds_of(channels)}
    for name, value in kpis.items():
        # A KPI of one maneuver is called "NAME (MANEUVER)".
        unit = units.get(name, units.get(name.rpartition(" (")[0], ""))
        yield name, f"{value:.4g} {unit}".strip()
