"""Go on with the description that a study keeps."""

import shlex
from pathlib import Path
from typing import Any

from prefcal_env.errors import SettingsError, StudyError
from prefcal_scenarios.own.source import joined_source, split_source


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
