"""Units of the generic KPIs of tracking, by their names."""

from collections.abc import Iterable, Mapping
from typing import Any


def tracking_units(channels: Any) -> dict[str, str]:
    """Return the unit of each KPI of `tracking_kpis` by name, as if all outputs had references.

    Args:
        channels: `Channels` of the experiments, which can show these units themselves.
    """
    units: dict[str, str] = {}
    time = channels.time_unit
    for channel in channels.y:
        units |= {
            f"integrated error of {channel.name}": f"{channel.unit} {time}".strip(),
            f"late error of {channel.name}": f"{channel.unit} {time}²".strip(),
            f"settling time of {channel.name}": time,
            f"overshoot of {channel.name}": channel.unit,
            f"final error of {channel.name}": channel.unit,
        }
    for channel in channels.u:
        kinds = ("total move", "largest move", "RMS move")
        units |= {f"{kind} of {channel.name}": channel.unit for kind in kinds}
    return units


def with_units(kpis: Mapping[str, float], channels: Any) -> Iterable[tuple[str, str]]:
    """Yield the name of each KPI, and its value with its unit if the channels tell that."""
    units = tracking_units(channels)
    for name, value in kpis.items():
        # A KPI of one maneuver is called "NAME (MANEUVER)".
        unit = units.get(name, units.get(name.rpartition(" (")[0], ""))
        yield name, f"{value:.4g} {unit}".strip()
