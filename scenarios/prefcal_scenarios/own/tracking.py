"""Find KPIs for a scenario that states none: the tracking KPIs that its channels allow."""

from collections.abc import Mapping, Sequence
from typing import Any

from prefcal_env.experiments.experiment import Channels
from prefcal_env.experiments.kpi_units import OF_OUTPUT, kinds_of

_MOST = 10
"""Number of found KPIs that people still read."""
_SHOWN = ("settling time", "overshoot", "integrated error", "total move")
"""Kinds of KPIs that are found, in the order in which they are shown."""
_DROPPED = ("integrated error", "overshoot", "total move")
"""Kinds that are left out, in this order, if there are too many KPIs to read."""

Row = dict[str, Any]
"""The arguments of one `prefcal_scenarios.scenario.KPI`."""


def tracking_rows(channels: Channels) -> dict[str, Row]:
    """Return every tracking KPI that the channels allow, by name, as arguments of a `KPI`.

    Args:
        channels: Channels of the experiments; every output counts as one with a reference.
    """
    time = channels.time_unit
    return {
        kind.of(channel): {
            "name": kind.of(channel),
            "title": kind.of(channel),
            "unit": kind.unit_of(channel, time),
            "better": "lower",
            "about": kind.about,
        }
        for kind, channel in kinds_of(channels)
    }


def found_rows(channels: Channels, measured: Mapping[str, float] | None = None) -> list[Row]:
    """Return the few tracking KPIs to show to people, the most important first.

    Args:
        channels: Channels of the experiments.
        measured: KPIs of an experiment: only these are found. With None, those of the outputs
            with a target, and of the inputs.
    """
    aimed = tuple(c for c in channels.y if c.target is not None or measured is not None)
    rows = tracking_rows(Channels((), channels.u, aimed, channels.time_unit))
    there = [n for n in rows if measured is None or n in measured]
    if not any(name.startswith(tuple(kind.name for kind in OF_OUTPUT)) for name in there):
        return []  # nothing is tracked: moves alone would ask for a controller that does nothing
    kinds = list(_SHOWN)
    for kind in ("", *_DROPPED):
        kinds = [k for k in kinds if k != kind]
        names = [n for k in kinds for n in there if n.startswith(f"{k} of ")]
        if len(names) <= _MOST:
            break
    return [rows[name] for name in names]


def promised(channels: Channels | None, names: Sequence[str]) -> list[str]:
    """Return those of `names` that channels allow, since others lack a target; all if unknown."""
    if channels is None:
        return list(names)
    there = {row["name"] for row in found_rows(channels)}
    return [name for name in names if name in there]
