"""Make a scenario of a live plant that a TOML file describes."""

from pathlib import Path

from prefcal_env.errors import KnobError, LiveError, ScenarioError, SettingsError
from prefcal_env.experiments.experiment import SOMETIMES
from prefcal_env.experiments.kpis import every_tracking_kpi, found_kpis
from prefcal_env.knobs import Knob
from prefcal_env.worlds.live import live_rig
from prefcal_scenarios.described.description import Description
from prefcal_scenarios.scenario import Scenario


def described(d: Description, knobs: list[Knob], where: str) -> Scenario:
    """Return the scenario of a description.

    Raises:
        ScenarioError: If a value is wrong, or not in the table [opcua]; the message says where.
        MissingExtraError: If asyncua is not installed.
    """
    knob = '[opcua.knobs] with K_p = { node = "...", low = 1, high = 5, rate = 1 }'
    for key, given, instead in (
        ("[knobs]", knobs, knob),
        ("[reference]", d.reference, "[opcua.references], since it is read from the plant"),
        ("stop_time", d.stop_time is not None, "duration in [opcua]"),
    ):
        if given:
            raise ScenarioError(f"{where}: a live plant takes no {key}: write {instead}")
    try:
        rig = live_rig(d.of)
    except (KnobError, LiveError, SettingsError) as error:
        raise ScenarioError(f"{where}, [opcua]: {error}") from error
    sure = (name for name in every_tracking_kpi(rig.channels) if not name.startswith(SOMETIMES))
    kpis = found_kpis(rig.channels, tuple(sure))
    name = Path(where).stem
    return Scenario(name, f"Live plant {name}", rig.space, rig, kpis=kpis)
