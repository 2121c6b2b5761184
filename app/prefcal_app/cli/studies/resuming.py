"""Check that a resumed study goes on as it was started."""

import shlex
from collections.abc import Mapping
from typing import Any

from prefcal_app.cli.parameters import Kept, Parameter


def check_programs(kept: Mapping[str, Any], given: Mapping[str, Any]) -> None:
    """Raise SettingsError if the study's program or configuration is not the one given."""
    from prefcal_env.errors import SettingsError  # here, and below: `prefcal --help` need not load them
    from prefcal_scenarios.names import is_described, is_own
    from prefcal_scenarios.own.source import split_source

    for name, does in (("cost", "goes by a cost that was given to it"), ("twin", "simulates with a program")):
        program = str(kept.get(name) or "")
        if given.get(name) is None and is_own(program):
            raise SettingsError(f"the study {does}: if you trust it, add --{name} {shlex.quote(program)}")
    if is_described(str(kept.get("scenario", ""))):
        return  # checked when its source was made
    # The configuration's file may have moved, so compare only its content.
    then = split_source(str(kept.get("scenario", "")))[1]
    now = then if given.get("scenario") is None else split_source(given["scenario"])[1]
    if now != then:
        said = "no --config" if then is None else f"the configuration {then}"
        raise SettingsError(
            f"the study was started with {said}, got {'none' if now is None else now}: give the "
            "same one, or start another study"
        )


def check_unchanged(
    rules: Mapping[str, tuple[Parameter, Kept]], kept: Mapping[str, Any], given: Mapping[str, Any]
) -> None:
    """Raise SettingsError if an option that cannot change has a new value."""
    from prefcal_env.errors import SettingsError

    for name, (parameter, rule) in rules.items():
        value, then = given.get(name), kept.get(name)
        if rule.anew or value is None or value == then:
            continue
        raise SettingsError(
            f"the study was started with {parameter.said(then)}, got {parameter.said(value)}: "
            "leave the option out, or start another study"
        )
    wanted = given.get("n_max")
    if wanted is not None and wanted < kept["n_max"]:
        raise SettingsError(
            f"--n-max must not be below the {kept['n_max']} that the study has by now, got {wanted}"
        )
