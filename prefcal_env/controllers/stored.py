"""Controllers as plain data, for files: nothing is executed to make them again."""

from collections.abc import Mapping
from typing import Any, Protocol, Self, TypeVar

import numpy as np

from prefcal_env.errors import SettingsError
from prefcal_env.experiments.control import Controller


class Storable(Controller, Protocol):
    """A controller that plain data describe completely."""

    def as_data(self) -> dict[str, Any]:
        """Return what `of_data` makes the controller of, as JSON-able data without infinite numbers."""

    @classmethod
    def of_data(cls, data: Mapping[str, Any]) -> Self:
        """Return the controller that `as_data` describes."""


Kind = TypeVar("Kind", bound=type[Storable])
KINDS: dict[str, type[Storable]] = {}
"""Controllers that `from_data` makes, by the names of their classes."""
_INFINITE = {"T_i": np.inf, "low": -np.inf, "high": np.inf}
"""Numbers that may be infinite, which are None in the data."""


def storable(kind: Kind) -> Kind:
    """Let `as_data` and `from_data` know a class of controllers; it decorates the class."""
    KINDS[kind.__name__] = kind
    return kind


def as_data(controller: Controller) -> dict[str, Any]:
    """Return a controller of this package as JSON-able data, from which `from_data` makes it.

    Infinite numbers become None. The memory of a run is not kept.

    Raises:
        SettingsError: If the controller is of another kind.
    """
    for name, kind in KINDS.items():
        if isinstance(controller, kind):
            return {"controller": name, **controller.as_data()}
    raise SettingsError(f"no data can hold a controller of type {type(controller).__name__}")


def from_data(data: Mapping[str, Any]) -> Controller:
    """Return the controller that `as_data` describes.

    Raises:
        SettingsError: If `data` describes no controller of this package.
    """
    kind = data.get("controller")
    if kind not in KINDS:
        raise SettingsError(f"controller must be one of {sorted(KINDS)}, got {kind!r}")
    try:
        return KINDS[kind].of_data({k: v for k, v in data.items() if k != "controller"})
    except (TypeError, KeyError, AttributeError, ValueError) as error:
        raise SettingsError(f"the data of a {kind} do not fit: {error}") from error


def finite(value: float | None) -> float | None:
    """Return a number for the data: None if it is infinite or unknown."""
    return value if value is not None and np.isfinite(value) else None


def infinite(name: str, value: Any) -> Any:
    """Return the value of the number called `name` in the data, where None may mean infinite."""
    return _INFINITE.get(name) if value is None else value
