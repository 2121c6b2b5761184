"""Turn the options that describe a scenario into its source, and back into options."""

from collections.abc import Mapping
from typing import Any

from prefcal_app.cli.cost_file import kept_cost
from prefcal_app.cli.studies.files import open_described
from prefcal_env.errors import SettingsError
from prefcal_env.study import study_path
from prefcal_scenarios.described.options import FLAGS
from prefcal_scenarios.described.resuming import resumed_source
from prefcal_scenarios.described.words import knob_of, listed, named_numbers
from prefcal_scenarios.names import CONTROLLERS, is_described
from prefcal_scenarios.own.source import joined_source, split_source, with_config_of


def source_of(given: Mapping[str, Any]) -> str:
    """Return the source of the scenario that the options describe.

    A study that is resumed keeps what is not given, except programs: a study from another person
    must not decide which program runs here.

    Args:
        given: Values of the fields of `Options`, None for options that were not typed.

    Raises:
        ScenarioError: If an option cannot be read.
        SettingsError: If an option does not fit the scenario, or differs from the study's.
    """
    source = with_config_of(given["scenario"], given.get("config"))
    words = _typed(given)
    if not is_described(source):
        _refuse(source, words)
        return source
    name, config = split_source(source)
    wanted = {**(config or {}), **words}
    source = joined_source(name, wanted) if wanted else name
    configuration = _kept(given.get("study"))
    kept = "" if configuration is None else str(configuration["scenario"])
    # Another scenario is refused when the study is opened.
    return resumed_source(kept, source) if is_described(kept) else source


def cost_of(given: Mapping[str, Any]) -> str | None:
    """Return the cost that the options name, or else the KPI that a resumed study keeps.

    Args:
        given: Values of the fields of `Options`, None for options that were not typed.
    """
    cost: str | None = given.get("cost")
    configuration = _kept(given.get("study")) if cost is None else None
    return cost if configuration is None else kept_cost(configuration["options"])


def _typed(given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the typed options as keys of a description."""
    found: dict[str, Any] = {}
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
    for key in ("plant", "stop_time"):
        if given.get(key) is not None:
            found[key] = given[key]
    return found


def _refuse(source: str, words: Mapping[str, Any]) -> None:
    if not words:
        return
    first = next(iter(words))
    raise SettingsError(
        f"{FLAGS[first]} describes an FMU, a TOML file or a standard controller "
        f"({', '.join(CONTROLLERS)}), not {source!r}: leave it out"
    )


def _kept(study: str | None) -> Mapping[str, Any] | None:
    """Return what an existing study was started with; None if there is none to resume."""
    if study is None or not study_path(study).is_file():
        return None
    with open_described(study_path(study)) as file:
        return file.state.configuration
