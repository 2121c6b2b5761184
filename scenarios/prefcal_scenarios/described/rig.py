"""Make a rig, a plant that only a person can run, of plain data."""

from collections.abc import Mapping
from typing import Any

from prefcal_env.described import Keys
from prefcal_env.errors import ScenarioError
from prefcal_env.experiments.experiment import Channel, Channels
from prefcal_env.sources import Rig
from prefcal_env.wording import did_you_mean

from .description import stated

_Signals = dict[str, dict[str, Any]]
_SIGNALS: Keys = {"outputs": (_Signals, True), "inputs": (_Signals, False), "time_unit": (str, False)}
"""Keys of a rig that are no arguments of `Rig`."""
_SENSOR: Keys = {"sensor": (tuple[float, float] | None, False)}
"""Key of a signal that is no argument of `Channel`."""


def rig_of(values: Mapping[str, Any], reference: Mapping[str, float], where: str) -> Rig:
    """Return the rig that the table [rig] describes.

    Args:
        values: Keys of the table.
        reference: Reference of each output that has one, in its unit.
        where: Name of the file, for messages.

    Raises:
        ScenarioError: If a key is unknown or missing, or has the wrong type, or a reference names
            no output.
        ExperimentError: If a limit is not valid.
        SettingsError: If a range is not valid.
    """
    made = ("channels", "y_ref", "kpis", "ranges")
    given = stated(values, f"{where}, [rig]", _SIGNALS, Rig, known=made, partial=False)
    signals = {
        group: {name: _signal(name, row, f"{where}, [rig.{group}] {name}") for name, row in rows.items()}
        for group, rows in (("outputs", given.pop("outputs")), ("inputs", given.pop("inputs", {})))
    }
    outputs, inputs = signals["outputs"], signals["inputs"]
    for name in reference:
        if name not in outputs:
            raise ScenarioError(
                f"{where}, [reference]: no output of the rig is called {name!r}."
                f"{did_you_mean(name, outputs)} There are {', '.join(outputs)}"
            )
    sensors = {name: row.pop("sensor", None) for name, row in (*outputs.items(), *inputs.items())}
    x = tuple(_channel(row, reference.get(name)) for name, row in outputs.items())
    y, u = tuple(c for c in x if c.target is not None), tuple(_channel(row) for row in inputs.values())
    return Rig(
        channels=Channels(x, u, y, given.pop("time_unit", "s")),
        y_ref=tuple(c.target for c in y if c.target is not None),
        ranges={name: sensor for name, sensor in sensors.items() if sensor is not None},
        instructions=given.pop("instructions", "").strip(),
        **given,
    )


def _signal(name: str, row: Mapping[str, Any], where: str) -> dict[str, Any]:
    return {"name": name, **stated(row, where, Channel, _SENSOR, known=("name", "target", "symbol"))}


def _channel(row: Mapping[str, Any], target: float | None = None) -> Channel:
    """Return a channel; only one with a target has a band."""
    return Channel(**{**row, "target": target, "band": row.get("band") if target is not None else None})
