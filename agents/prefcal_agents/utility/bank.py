"""θ whose KPIs are known: simulated ones that Screening chooses from, or experiments."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from prefcal_env.knobs.space import KnobSpace
from prefcal_env.preferences.kpis import Outcome


@dataclass(frozen=True, eq=False, slots=True)
class Bank:
    """θ and their KPIs, in the order simulated or run.

    Args:
        z: Points of the unit cube, shape (m, n).
        thetas: θ, physical, shape (m, n).
        names: Names of the KPIs.
        kpis: KPIs, lower is better; infinite where one is missing, shape (m, k).
        failed: Whether each simulation failed: it has no KPI at all, shape (m,).
    """

    z: Float[np.ndarray, "m n"]
    thetas: Float[np.ndarray, "m n"]
    names: tuple[str, ...]
    kpis: Float[np.ndarray, "m k"]
    failed: Bool[np.ndarray, " m"]

    def __post_init__(self) -> None:
        for array in (self.z, self.thetas, self.kpis, self.failed):
            array.setflags(write=False)

    def __len__(self) -> int:
        return len(self.z)

    @classmethod
    def of(
        cls, z: Float[np.ndarray, "m n"], thetas: Float[np.ndarray, "m n"], outcomes: Sequence[Outcome]
    ) -> "Bank":
        """Return the bank of m simulated θ; a KPI that an experiment lacks is infinite.

        Of rows with the same θ, which rounding of knobs gives, only the first is kept.
        """
        _, first = np.unique(thetas + 0.0, axis=0, return_index=True)  # -0.0 is 0.0
        first.sort()
        z, thetas, outcomes = z[first], thetas[first], [outcomes[k] for k in first]
        names = tuple(sorted({name for outcome in outcomes for name in outcome}))
        kpis = [[outcome.get(name, np.inf) for name in names] for outcome in outcomes]
        failed = np.array([not outcome for outcome in outcomes], dtype=np.bool_)
        values = np.array(kpis, dtype=float).reshape(len(z), len(names))
        return cls(z, thetas, names, values, failed)

    @property
    def hopeless(self) -> Bool[np.ndarray, " m"]:
        """Return which θ have no finite KPI, shape (m,): they failed, or were interrupted."""
        return np.asarray(np.isinf(self.kpis).all(axis=1))

    def find(self, theta: Sequence[float] | Float[np.ndarray, " n"]) -> int:
        """Return the row of a physical θ. Raises KeyError if it was not simulated."""
        rows = np.flatnonzero(np.all(self.thetas == np.asarray(theta, dtype=float), axis=1))
        if not len(rows):
            raise KeyError(tuple(theta))
        return int(rows[0])


def runnable(
    space: KnobSpace, z: Float[np.ndarray, "m n"]
) -> tuple[Float[np.ndarray, "m n"], Float[np.ndarray, "m n"]]:
    """Return points of the cube and their physical θ exactly as an agent would show them.

    So a θ that is shown is one that was simulated, to the last bit, and rounding leaves neither the
    searched range nor the constraints. Both have shape (m, n).
    """
    snapped = np.array([space.snap(point) for point in z]).reshape(z.shape)
    return snapped, np.array([space.decode(point) for point in snapped]).reshape(z.shape)
