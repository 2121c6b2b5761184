"""Kinds of tracking KPIs: their names, units and meanings, which need no experiment."""

from collections.abc import Iterator
from typing import Any

Kind = tuple[str, str, str]
"""Name of a kind of KPI, its unit for a channel with {unit} and for {time}, and its meaning."""
OF_OUTPUT: tuple[Kind, ...] = (
    ("integrated error", "{unit} {time}", "Area between the curve and its reference."),
    ("late error", "{unit} {time}²", "Area between the curve and its reference, weighted with time."),
    ("settling time", "{time}", "Time of the last entry into the band around the reference."),
    ("overshoot", "{unit}", "Largest distance beyond the reference, on the other side than the start."),
    ("final error", "{unit}", "Distance from the reference at the end."),
)
"""Kinds of each output with a reference, in the order in which `tracking_kpis` computes them."""
OF_INPUT: tuple[Kind, ...] = (
    ("total move", "{unit}", "Sum of all changes of the input: how much the actuator works."),
    ("largest move", "{unit}", "Largest change of the input from one instant to the next."),
    ("RMS move", "{unit}", "Root mean square of the changes of the input."),
)
"""Kinds of each input, likewise."""


def kinds_of(channels: Any) -> Iterator[tuple[str, str, str]]:
    """Yield name, unit and meaning of each KPI of `Channels`, as if all outputs had references."""
    for kinds, group in ((OF_OUTPUT, channels.y), (OF_INPUT, channels.u)):
        for channel in group:
            for kind, unit, about in kinds:
                plain = unit.format(unit=channel.unit, time=channels.time_unit)
                yield f"{kind} of {channel.name}", plain.strip(), about
