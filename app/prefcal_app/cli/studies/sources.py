"""Complete what a user types by what a study keeps: its scenario and its cost, but no programs."""

import shlex
from collections.abc import Mapping
from typing import Any

from prefcal_env.errors import SettingsError, StudyError
from prefcal_env.optional import WORLDS
from prefcal_env.study import study_path
from prefcal_scenarios.described.options import FLAGS, resumed_source, words_to_resume
from prefcal_scenarios.described.words import knob_of, listed, named_numbers
from prefcal_scenarios.names import CONTROLLERS, is_built_in, is_described, is_own
from prefcal_scenarios.own.source import joined_source, split_source, with_config_of

from .files import existing, open_described


def completed(given: Mapping[str, Any]) -> dict[str, Any]:
    """Return `given` with the source of the scenario that the options describe, and the cost.

    An existing study keeps what is not given, except programs: a study from another person must
    not decide which program runs here. So a scenario that is not given must be a built-in one, or
    be described by a plant that is.

    Args:
        given: Values of a command's options by name, None for options that were not typed.

    Raises:
        ScenarioError: If an option cannot be read.
        SettingsError: If an option does not fit the scenario, or differs from the study's.
        StudyError: If there is no such study where no scenario is given, or its scenario is a
            program that is not named.
    """
    source, study, words = given["scenario"], given.get("study"), _described(given)
    kept: Mapping[str, Any] = {}
    if study is not None and (source is None or study_path(study).is_file()):
        with open_described(existing(study)) as file:
            kept = file.state.configuration
    if source is None and words:
        source = split_source(kept["scenario"])[0]  # the study keeps the rest
        if not is_described(source):
            raise SettingsError(f"study {study!r} has no plant of its own: leave --plant out")
    if source is not None:
        source = _with_words(with_config_of(source, given.get("config")), words)
    cost = given.get("cost")
    if kept:
        source = _trusted(str(study), kept["scenario"], source)
        cost = _kept_cost(kept["options"]) if cost is None else cost
    return {**given, "scenario": source, "cost": cost}


def _with_words(source: str, words: Mapping[str, Any]) -> str:
    """Return `source` with what the options describe. Raises SettingsError if it takes none."""
    if is_described(source):
        name, config = split_source(source)
        wanted = {**(config or {}), **words}
        return joined_source(name, wanted) if wanted else name
    if words:
        files = [f"{world.called}, " for world in WORLDS if world.ending]
        raise SettingsError(
            f"{FLAGS[next(iter(words))]} describes {''.join(files)}a TOML file or a standard controller "
            f"({', '.join(CONTROLLERS)}), not {source!r}: leave it out"
        )
    return source


def _described(given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the typed options as keys of a description."""
    found = {key: given[key] for key in ("plant", "stop_time") if given.get(key) is not None}
    if given.get("knob"):
        names = [knob_of(text).name for text in given["knob"]]
        texts = [text.partition("=")[2].strip() for text in given["knob"]]
        twice = [name for name in names if names.count(name) > 1]
        if twice:
            raise SettingsError(f"--knob gives {twice[0]!r} twice")
        found["knobs"] = dict(zip(names, texts, strict=True))
    if given.get("show"):
        found["show"] = listed(given["show"])
    if given.get("reference"):
        found["reference"] = named_numbers(given["reference"], "--reference")
    return found


def _kept_cost(stored: Mapping[str, Any]) -> str | None:
    """Return the cost to use again from the options that a study keeps; None for a program.

    A study from another person must not decide which program runs here; a KPI's name is none.
    """
    cost = stored.get("cost")
    return None if cost is None or is_own(str(cost)) else str(cost)


def _trusted(name: str, named: str, source: str | None) -> str:
    """Return the scenario of the study called `name`, if the user trusts it.

    Args:
        name: Name of the study.
        named: Scenario that the study names.
        source: Scenario that the user names; None to use the study's if it is built in.

    Raises:
        StudyError: If the study names a program and the user does not.
    """
    if source is None and not is_built_in(named):
        # A study from another person must not decide which program runs here.
        short, *plant = words_to_resume(named)  # the study keeps the rest
        option = plant or ["--scenario", short]
        raise StudyError(
            f"study {name!r} calibrates {' '.join([short, *plant])!r}, which is a program: if you "
            f"trust it, add {shlex.join(option)}"
        )
    if source is not None and is_described(source) and is_described(named):
        return resumed_source(named, source)
    return source or named
