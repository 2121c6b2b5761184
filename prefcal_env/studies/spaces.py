"""The knobs of a study, as its configuration holds them."""

from collections.abc import Mapping
from typing import Any

from prefcal_env.errors import KnobError, StudyError
from prefcal_env.knobs import Knob, KnobSpace


def knobs_as_dicts(space: KnobSpace) -> list[dict[str, Any]]:
    """The knobs as plain data."""
    return [
        {
            "name": k.name, "low": float(k.low), "high": float(k.high), "unit": k.unit,
            "scale": k.scale, "integer": bool(k.integer),
        }
        for k in space
    ]  # fmt: skip


def within_as_dict(space: KnobSpace) -> dict[str, list[float]]:
    """What is searched of each knob, as plain data."""
    return {name: list(part) for name, part in zip(space.names, space.within, strict=True)}


def space_of(configuration: Mapping[str, Any]) -> KnobSpace:
    """The space of a configuration, or of a `Respaced` event: its knobs, and what is searched.

    Raises:
        StudyError: that cannot be read.
    """
    try:
        knobs = [Knob(**knob) for knob in configuration["knobs"]]
        within = configuration.get("within", {})
        parts = {name: (low, high) for name, (low, high) in within.items()}
        return KnobSpace(knobs, within=parts)
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError, KnobError) as error:
        raise StudyError(f"the knobs of the study cannot be read: {error}") from error
