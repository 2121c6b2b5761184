"""What controllers share: plain data for files, and how they read what was measured."""

from collections.abc import Mapping, Sequence
from typing import Any, Protocol, Self, TypeVar

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import PlantError, SettingsError
from prefcal_env.experiments.experiment import Channel, Controller, Measurement
from prefcal_env.plants.plant import Plant

# --- Controllers as plain data, for files: nothing is executed to make them again.


class Storable(Controller, Protocol):
    """A controller that plain data describe completely."""

    def as_data(self) -> dict[str, Any]:
        """Return what `of_data` makes the controller of, as JSON-able data without infinite numbers."""

    @classmethod
    def of_data(cls, data: Mapping[str, Any]) -> Self:
        """Return the controller that `as_data` describes."""


Kind = TypeVar("Kind", bound=type[Storable])
KINDS: dict[str, type[Storable]] = {}
"""Controllers that `from_data` makes, by the names of their classes; `kind_of` adds the MPC."""


def storable(kind: Kind) -> Kind:
    """Let `as_data` and `from_data` know a class of controllers; it decorates the class."""
    # By the class's own name, so that best.json needs no table of names.
    KINDS[kind.__name__] = kind
    return kind


def kind_of(name: Any) -> type[Storable] | None:
    """Return the class of controllers that data call `name`; None if there is none."""
    if name == "LinearMPC" and name not in KINDS:
        from prefcal_env.mpc import LinearMPC  # here: it loads the compiler

        storable(LinearMPC)
    return KINDS.get(name) if isinstance(name, str) else None


def as_data(controller: Controller) -> dict[str, Any]:
    """Return a controller of this package as JSON-able data, from which `from_data` makes it.

    Infinite numbers become None. The memory of a run is not kept.

    Raises:
        SettingsError: If the controller is of another kind.
    """
    kind_of(type(controller).__name__)
    for name, kind in KINDS.items():
        if isinstance(controller, kind):
            return {"controller": name, **controller.as_data()}
    raise SettingsError(f"no data can hold a controller of type {type(controller).__name__}")


def from_data(data: Mapping[str, Any]) -> Controller:
    """Return the controller that `as_data` describes.

    Raises:
        SettingsError: If `data` describes no controller of this package.
    """
    name = data.get("controller")
    kind = kind_of(name)
    if kind is None:
        raise SettingsError(f"controller must be one of {sorted({*KINDS, 'LinearMPC'})}, got {name!r:.80}")
    if _holds_truth(data):  # numpy would read true as 1
        raise SettingsError(f"the data of a {name} do not fit: they must be numbers, got true or false")
    try:
        # Only classes that said so are made: a file that was sent to you must not choose what runs.
        return kind.of_data({k: v for k, v in data.items() if k != "controller"})
    except KeyError as error:
        raise SettingsError(f"the data of a {name} do not fit: {error} is missing") from error
    except (TypeError, IndexError, AttributeError, ValueError, OverflowError, PlantError) as error:
        raise SettingsError(f"the data of a {name} do not fit: {error!s:.200}") from error


def _holds_truth(data: Any) -> bool:
    inner = data.values() if isinstance(data, Mapping) else data if isinstance(data, list | tuple) else ()
    return isinstance(data, bool) or any(map(_holds_truth, inner))


def finite(value: float | None) -> float | None:
    """Return a number for the data: None if it is infinite or unknown."""
    return value if value is not None and np.isfinite(value) else None


def infinite(name: str, value: Any) -> Any:
    """Return the value of the number called `name` in the data, where None may mean infinite."""
    return {"T_i": np.inf, "low": -np.inf, "high": np.inf}.get(name) if value is None else value


# --- Read what was measured, and find channels by name.


def outputs_of(m: Measurement, plant: Plant | None = None) -> Float[np.ndarray, " n_y"]:
    """Return the measured outputs, shape (n_y,), in their units.

    A measurement without outputs has the state only: then y = g(x, u, d) of `plant`, or, without
    a plant, y = x.
    """
    if len(m.y):
        return m.y
    if plant is None:
        return np.asarray(m.x, dtype=float)
    # With a preview, the first row is what acts now; an estimator may have appended its own to it.
    d = m.d if m.d.ndim == 1 else m.d[0]
    return plant.g(m.x, m.u, d[: len(plant.disturbances)])


def reference_of(m: Measurement) -> Float[np.ndarray, " n_y"]:
    """Return the present output references, shape (n_y,), with or without a preview."""
    return m.y_ref if m.y_ref.ndim == 1 else m.y_ref[0]


def index_of(which: int | str, channels: Sequence[Channel] | None, kind: str) -> int:
    """Return the index of a channel that is given by index or name.

    Args:
        which: Index from 0, or name.
        channels: Channels to choose from; None if they are not known.
        kind: What they are, "output" or "input", for messages.

    Raises:
        SettingsError: If there is no such channel, or a name is given without channels.
    """
    if isinstance(which, str):
        if channels is None:
            raise SettingsError(f"{kind} {which!r}: a name needs the plant; pass plant=, or a number")
        names = [c.name for c in channels]
        if names.count(which) != 1:
            raise SettingsError(f"{kind} must be one of {names}, got {which!r}")
        return names.index(which)
    known = np.inf if channels is None else len(channels)
    if isinstance(which, bool) or not isinstance(which, int | np.integer) or not 0 <= which < known:
        upto = "" if channels is None else f" below {len(channels)}"
        raise SettingsError(f"{kind} must be a name or a number from 0{upto}, got {which!r}")
    return int(which)
