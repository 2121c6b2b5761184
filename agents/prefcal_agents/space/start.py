"""Use θ that a person already has, such as the current tuning, as the first samples."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import KnobError, SettingsError
from prefcal_env.knobs.key import theta_key
from prefcal_env.knobs.space import KnobSpace

Points = tuple[tuple[float, ...], ...]
"""Points of the cube, each of length n."""
Start = Sequence[Float[np.ndarray, " n"]] | Sequence[Sequence[float]] | Sequence[float] | np.ndarray
"""One physical θ, shape (n,), or several."""


def start_points(space: KnobSpace, start: Start | None, n_max: int) -> Points:
    """Return the θ in `start` as points of the cube, in order, each of length n.

    They replace the first samples of the initial design.

    Args:
        space: Knobs to tune.
        start: One physical θ, shape (n,), or several; None or empty for no warm start.
        n_max: Number of experiments.

    Raises:
        KnobError: If a θ is not in `space`; the message names the knob, the value and its unit.
        SettingsError: If a θ is given twice, or there are more θ than experiments.
    """
    if start is None:
        return ()
    if isinstance(start, str) or not isinstance(start, (Sequence, np.ndarray)):
        raise SettingsError(f"start must be one or more physical θ, got {start!r}")
    if len(start) == 0:
        return ()
    thetas = [start] if isinstance(start[0], (int, float, np.number)) else list(start)
    if len(thetas) > n_max:
        raise SettingsError(f"start must not hold more θ than n_max {n_max}, got {len(thetas)}")
    points: dict[bytes, tuple[float, ...]] = {}
    for number, theta in enumerate(thetas, start=1):
        try:
            z = space.encode(space.check_allowed(np.array(theta, dtype=float)))
        except (TypeError, ValueError, KnobError) as error:
            which = f"start θ {number}" if len(thetas) > 1 else "start"
            raise KnobError(f"{which}: {error}") from error
        key = theta_key(space.decode(z))
        if key in points:
            raise SettingsError(
                f"start must not hold one θ twice: number {number} is {space.decode(z)} again"
            )
        points[key] = tuple(map(float, z))
    return tuple(points.values())
