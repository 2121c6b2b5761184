"""Write a description as options of the command line, and go on with the one that a study keeps."""

import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from prefcal_env.errors import SettingsError, StudyError
from prefcal_scenarios.names import is_described
from prefcal_scenarios.own.source import joined_source, split_source

FLAGS = {
    "knobs": "--knob",
    "show": "--show",
    "reference": "--reference",
    "plant": "--plant",
    "stop_time": "--stop-time",
}
"""Keys of a description and the options that set them."""


def words_of(source: str) -> list[str]:
    """Return the words of a command line that describe a scenario like `source` does."""
    name, config = split_source(source)
    if config is None or not is_described(name) or not _is_plain(config):
        return [source]
    words = [name]
    for knob, text in config.get("knobs", {}).items():
        words += ["--knob", f"{knob}={text}"]
    if config.get("show"):
        words += ["--show", ",".join(config["show"])]
    for output, value in config.get("reference", {}).items():
        words += ["--reference", f"{output}={value!r}"]
    for key in ("plant", "stop_time"):
        if key in config:
            words += [FLAGS[key], str(config[key])]
    return words


def words_to_resume(source: str) -> list[str]:
    """Return the words that name the scenario of an existing study: the study keeps the rest."""
    name, config = split_source(source)
    if not is_described(name):
        return [source]
    plant = (config or {}).get("plant")
    return [name] if plant is None else [name, "--plant", str(plant)]


def _is_plain(config: Mapping[str, Any]) -> bool:
    """Return whether options can say all of a configuration."""
    knobs = config.get("knobs", {})
    return config.keys() <= FLAGS.keys() and all(isinstance(text, str) for text in knobs.values())


def resumed_source(kept: str, source: str) -> str:
    """Return the source of a study's scenario, where `source` may leave out what is kept.

    A plant is a program, so it must be named again: a study from another person must not decide
    which program runs here. It may have moved, like the scenario's own file.

    Args:
        kept: Source that the study keeps.
        source: Source that the user names now.

    Raises:
        StudyError: If they are different scenarios.
        SettingsError: If `source` states another value, or leaves out the plant.
    """
    then, config = split_source(kept)
    name, wanted = split_source(source)
    if Path(then).name != Path(name).name:
        raise StudyError(f"the study calibrates {then!r}, not {name!r}: name that scenario")
    before, now = config or {}, wanted or {}
    for key, value in now.items():
        if not _same(key, before.get(key), value):
            said = f"{key} = {before[key]!r}" if key in before else f"no {key}"
            raise SettingsError(
                f"the study was started with {said}, got {value!r}: leave it out, or start another study"
            )
    if "plant" in before and "plant" not in now:
        raise SettingsError(
            "the study's plant is a program: if you trust it, add "
            f"--plant {shlex.quote(str(before['plant']))}"
        )
    merged = {**before, **now}
    return joined_source(name, merged) if merged else name


def _same(key: str, then: Any, now: Any) -> bool:
    if key == "plant" and isinstance(then, str) and isinstance(now, str):
        return Path(then).name == Path(now).name
    return bool(then == now)
