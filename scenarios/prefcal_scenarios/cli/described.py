"""Opening a study for people: its configuration may come from anybody, and is checked first."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from prefcal_env.errors import StudyError
from prefcal_env.studies import StudyFile
from prefcal_scenarios.cli.clock import wall_clock

_FIELDS: Mapping[str, type] = {
    "scenario": str, "name": str, "title": str, "seed": int, "knobs": list, "agent": dict,
    "options": dict, "versions": dict,
}  # fmt: skip
_OPTIONS: Mapping[str, tuple[type, ...]] = {
    "scenario": (str,), "calibrator": (str,), "agent": (str,), "seed": (int,), "n_init": (int,),
    "n_max": (int,), "delta": (int, float, type(None)), "tie_band": (int, float, type(None)),
    "answer_noise": (int, float, type(None)), "outcomes": (bool,), "cost": (str, type(None)),
    "start": (list,), "earlier": (str, type(None)), "processor": (str, type(None)),
}  # fmt: skip


def open_described(path: Path) -> StudyFile:
    """Open a study that `prefcal calibrate` could have made.

    A study file may hold any plain data as its configuration, and one that was imported must not
    break the list of all others.

    Raises:
        StudyError: it cannot be opened, or its configuration is not what we write.
    """
    file = StudyFile.open(path, clock=wall_clock)
    problem = _problem(file.state.configuration)
    if problem:
        file.close()
        raise StudyError(f"{path} is no study of prefcal calibrate: {problem}")
    return file


def _problem(configuration: Mapping[str, Any]) -> str:
    """What is wrong with a configuration; empty if nothing is."""
    for name, type_ in _FIELDS.items():
        if not _is(configuration.get(name), (type_,)):
            return f"its {name} must be {type_.__name__}"
    knobs, options = configuration["knobs"], configuration["options"]
    for knob in knobs:
        if not isinstance(knob, dict) or not all(
            _is(knob.get(k), (str,)) for k in ("name", "unit")
        ):
            return "its knobs must have names and units"
    if not _is(configuration["agent"].get("agent"), (str,)):
        return "its agent must have a name"
    if "calibrator" not in options:
        return "its options must name a calibrator"
    if not all(isinstance(theta, str) for theta in _listed(options.get("start"))):
        return "its option start must list texts"
    if not _is_taken(configuration.get("earlier")):
        return "what it says of an earlier study cannot be read"
    wrong = [k for k, types in _OPTIONS.items() if k in options and not _is(options[k], types)]
    return f"its option {wrong[0]} cannot be {options[wrong[0]]!r:.40}" if wrong else ""


def _is_taken(value: Any) -> bool:
    """Whether it is what `Taken.as_dict` gives; most studies have none."""
    if value is None:
        return True
    return isinstance(value, dict) and all(
        _is(value.get(name), (type_,))
        for name, type_ in (
            ("study", str),
            ("scenario", str),
            ("experiments", int),
            ("thetas", list),
        )
    )


def _listed(value: Any) -> list[Any]:
    return value if isinstance(value, list) else []


def _is(value: Any, types: tuple[type, ...]) -> bool:
    """Whether it is of these types; true and false are no numbers here."""
    return isinstance(value, types) and isinstance(value, bool) == (bool in types)
