"""Read what was measured, and find channels by name."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import SettingsError
from prefcal_env.experiments.control import Measurement
from prefcal_env.experiments.experiment import Channel
from prefcal_env.plants.plant import Plant


def outputs_of(m: Measurement, plant: Plant | None = None) -> Float[np.ndarray, " n_y"]:
    """Return the measured outputs, shape (n_y,), in their units.

    A measurement without outputs has the state only: then y = g(x, u, d) of `plant`, or, without
    a plant, y = x.
    """
    if len(m.y):
        return m.y
    if plant is None:
        return np.asarray(m.x, dtype=float)
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
