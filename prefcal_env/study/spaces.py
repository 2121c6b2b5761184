"""Convert the knobs of a study to and from its configuration."""

from collections.abc import Mapping
from typing import Any

import msgspec

from prefcal_env.errors import StudyError
from prefcal_env.knobs.knob import Knob
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.plain import UNREADABLE


class _Stored(msgspec.Struct, frozen=True):
    """Knobs, and the searched part of each knob by its name."""

    knobs: tuple[Knob, ...]
    within: dict[str, tuple[float, float]] = {}


def knobs_as_dicts(space: KnobSpace) -> list[dict[str, Any]]:
    """Return the knobs as plain data."""
    return [
        {
            "name": k.name,
            "low": float(k.low),
            "high": float(k.high),
            "unit": k.unit,
            "scale": k.scale,
            "integer": bool(k.integer),
        }
        for k in space
    ]


def within_as_dict(space: KnobSpace) -> dict[str, list[float]]:
    """Return the searched part of each knob as plain data."""
    return {name: list(part) for name, part in zip(space.names, space.within, strict=True)}


def space_of(configuration: Mapping[str, Any]) -> KnobSpace:
    """Return the space of plain data with "knobs", and perhaps "within"; others are ignored.

    Raises:
        StudyError: If the knobs cannot be read.
    """
    try:
        stored = msgspec.convert(dict(configuration), _Stored)
        return KnobSpace(stored.knobs, within=stored.within)
    except (*UNREADABLE, TypeError) as error:
        raise StudyError(f"the knobs of the study cannot be read: {error}") from error
