"""Run simulations for an agent, each θ once, and keep their KPIs."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import SettingsError
from prefcal_env.preferences.kpis import Outcome

Theta = Float[np.ndarray, " n"]
Simulate = Callable[[Theta], Mapping[str, float] | None]
"""Function of a physical θ, shape (n,), that returns KPIs by name, lower is better.

None or no KPIs: the simulation failed. If it has an attribute `many`, that is called with a list of
θ instead and returns their KPIs in the same order, for example from several processes.
"""


class Simulations:
    """The simulations of a study, shared by an agent and its copies; it only saves repeating them.

    Args:
        simulate: Function that simulates one θ.

    Raises:
        SettingsError: If it is not a function.
    """

    def __init__(self, simulate: Simulate) -> None:
        if not callable(simulate):
            raise SettingsError(f"simulate must be a function of θ, got {simulate!r}")
        self._simulate = simulate
        self._known: dict[bytes, Outcome] = {}

    @property
    def count(self) -> int:
        """Return the number of simulated θ."""
        return len(self._known)

    @property
    def failed(self) -> int:
        """Return the number of simulations that failed."""
        return sum(not outcome for outcome in self._known.values())

    def __call__(self, thetas: Float[np.ndarray, "m n"]) -> list[Outcome]:
        """Return the KPIs of each row of `thetas`; none for a simulation that failed."""
        keys = [_key(theta) for theta in thetas]
        new = {k: t for k, t in zip(keys, thetas, strict=True) if k not in self._known}
        if new:
            found = self._run([theta.copy() for theta in new.values()])
            self._known.update(zip(new, found, strict=True))
        return [self._known[key] for key in keys]

    def _run(self, thetas: Sequence[Theta]) -> list[Outcome]:
        many: Any = getattr(self._simulate, "many", None)
        found = many(thetas) if many is not None else [self._one(theta) for theta in thetas]
        return [Outcome(kpis or {}) for kpis in found]

    def _one(self, theta: Theta) -> Mapping[str, float] | None:
        return self._simulate(theta)


def _key(theta: Theta) -> bytes:
    return bytes((np.asarray(theta, dtype=float) + 0.0).tobytes())  # -0.0 is 0.0
