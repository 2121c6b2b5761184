"""Write a description as options of the command line."""

from collections.abc import Mapping
from typing import Any

from prefcal_scenarios.names import is_described
from prefcal_scenarios.own.source import split_source

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
