"""Load the plant that a file, the command line or a study names: model.py:plant."""

from pathlib import Path
from typing import Any

from prefcal_env.errors import PlantError, ScenarioError
from prefcal_env.knobs.knob import is_number
from prefcal_env.plants.systems.matrices import LIBRARIES
from prefcal_env.wording import did_you_mean
from prefcal_scenarios.own.own_file import module_at

_PARTS = ("f", "g", "hold", "jacobians", "states", "inputs", "outputs")
"""What every plant has."""
_KINDS = (
    f"a prefcal plant (FunctionPlant, Plant.of), a system of {LIBRARIES}, or a tuple of matrices (A, B, C, D)"
)


def plant_at(source: str) -> Any:
    """Return the plant at path/to/model.py:NAME; the file is executed.

    Raises:
        ScenarioError: If the file or the name in it does not exist, or it is not a plant.
    """
    path, _, name = source.rpartition(":")
    if not path.endswith(".py") or not name:
        raise ScenarioError(f"a plant must be path/to/model.py:NAME, got {source!r}")
    module = module_at(Path(path))
    there = [key for key in vars(module) if not key.startswith("_")]
    if name not in there:
        raise ScenarioError(f"nothing in {path!r} is called {name!r}.{did_you_mean(name, there)}")
    found = getattr(module, name)
    if is_number(found):  # a mere gain of a linear system, here most likely the wrong name
        raise ScenarioError(f"{source!r} must be {_KINDS}, got the number {found!r}")
    return found if is_plant(found) else _converted(found, source)


def is_plant(found: object) -> bool:
    """Return whether `found` has all parts of a plant."""
    return not isinstance(found, type) and all(hasattr(found, part) for part in _PARTS)


def _converted(found: Any, source: str) -> Any:
    from prefcal_env.plants.plant import Plant

    try:
        return Plant.of(found)
    except (PlantError, TypeError) as error:
        raise ScenarioError(f"{source!r} must be {_KINDS}: {error}") from error
