"""Make a rig, a plant that only a person can run, of plain data."""

from collections.abc import Mapping
from typing import Any

from prefcal_env.errors import ScenarioError
from prefcal_env.experiments.experiment import Channel, Channels
from prefcal_env.sources.rig import Rig
from prefcal_env.wording import did_you_mean

from .tables import RigTable, SignalTable, checked, stated


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
    given = stated(values, RigTable, f"{where}, [rig]", partial=False)
    outputs = _signals(given.pop("outputs"), f"{where}, [rig.outputs]")
    inputs = _signals(given.pop("inputs", {}), f"{where}, [rig.inputs]")
    for name in reference:
        if name not in outputs:
            raise ScenarioError(
                f"{where}, [reference]: no output of the rig is called {name!r}."
                f"{did_you_mean(name, outputs)} There are {', '.join(outputs)}"
            )
    x = tuple(_channel(n, s, reference.get(n)) for n, s in outputs.items())
    channels = Channels(
        x=x,
        u=tuple(_channel(n, s) for n, s in inputs.items()),
        y=tuple(c for c in x if c.target is not None),
        time_unit=given.pop("time_unit", "s"),
    )
    return Rig(
        channels=channels,
        y_ref=tuple(c.target for c in x if c.target is not None),
        ranges={n: s.sensor for n, s in {**outputs, **inputs}.items() if s.sensor is not None},
        instructions=given.pop("instructions", "").strip(),
        **given,
    )


def _signals(tables: Mapping[str, Mapping[str, Any]], where: str) -> dict[str, SignalTable]:
    return {name: checked(t, SignalTable, f"{where} {name}") for name, t in tables.items()}


def _channel(name: str, signal: SignalTable, target: float | None = None) -> Channel:
    band = signal.band if target is not None else None
    return Channel(name, signal.unit, signal.low, signal.high, target, band)
