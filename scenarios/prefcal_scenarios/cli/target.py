"""The processor that a study judges computation times on: given once, then kept in the study."""

from collections.abc import Mapping
from typing import Any

from prefcal_env.errors import SettingsError
from prefcal_env.mpc.processors import as_dict, processor_of, read_processor
from prefcal_scenarios.scenario import Scenario

_KEY = "processor"
"""Of the configuration of a study."""


def target_of(path: str | None, scenario: Scenario) -> dict[str, Any]:
    """Return what the configuration of a new study says of the processor in the file `path`.

    Empty without one: studies of before and of today read the same.

    Raises:
        SettingsError: not the file of a processor, or computing is no criterion of `scenario`.
    """
    if path is None:
        return {}
    if scenario.on_processor is None:
        raise SettingsError(
            f"--processor is for scenarios that judge computation times (overtake, "
            f"overtake-robust), not {scenario.name!r}"
        )
    return {_KEY: as_dict(read_processor(path))}


def check_target(path: str | None, configuration: Mapping[str, Any]) -> None:
    """Refuse another processor than the one that a study was started with.

    Raises:
        SettingsError: the file `path` holds another one, or the study was started without one.
    """
    if path is None:
        return
    kept = configuration.get(_KEY)
    if kept is None:
        raise SettingsError(
            f"the study was started with no --processor, got --processor {path}: leave the option "
            "out, or start another study"
        )
    if as_dict(read_processor(path)) != kept:
        raise SettingsError(
            f"the study judges computation times on {kept.get('name')!r}, which it keeps; "
            f"--processor {path} holds another one: leave the option out, or start another study"
        )


def on_target(scenario: Scenario, configuration: Mapping[str, Any]) -> Scenario:
    """Return `scenario`, judged on the processor that the study keeps if it keeps one.

    Raises:
        SettingsError: what the study keeps is no processor, or `scenario` takes none.
    """
    kept = configuration.get(_KEY)
    if kept is None:
        return scenario
    if scenario.on_processor is None:
        raise SettingsError(f"scenario {scenario.name!r} judges no computation times any more")
    return scenario.on_processor(scenario, processor_of(kept, "the processor of the study"))


def target_settings(configuration: Mapping[str, Any]) -> dict[str, str]:
    """Return the processor by name, for the report's list of what was set."""
    kept = configuration.get(_KEY)
    return {} if kept is None else {"processor": str(kept.get("name"))}
