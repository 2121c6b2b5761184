"""θ whose KPIs are known: simulated ones that Screening chooses from, or experiments."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int


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
        cls,
        z: Float[np.ndarray, "m n"],
        thetas: Float[np.ndarray, "m n"],
        columns: Mapping[str, Float[np.ndarray, " m"]],
    ) -> "Bank":
        """Return the bank of m simulated θ; a KPI that an experiment lacks is infinite.

        Of rows with the same θ, which rounding of knobs gives, only the first is kept.

        Args:
            z: Points of the unit cube, shape (m, n).
            thetas: θ, physical, shape (m, n).
            columns: Values of each KPI by name, shape (m,), NaN where it is not known.
        """
        _, first = np.unique(thetas + 0.0, axis=0, return_index=True)  # -0.0 is 0.0
        first.sort()
        table = {name: values[first] for name, values in sorted(columns.items())}
        names = tuple(name for name, values in table.items() if not np.isnan(values).all())
        kpis = np.empty((len(first), len(names)))
        for column, name in enumerate(names):
            kpis[:, column] = table[name]
        unknown = np.isnan(kpis)
        failed = np.asarray(unknown.all(axis=1))
        return cls(z[first], thetas[first], names, np.where(unknown, np.inf, kpis), failed)

    @property
    def hopeless(self) -> Bool[np.ndarray, " m"]:
        """Return which θ have no finite KPI, shape (m,): they failed, or were interrupted."""
        return np.asarray(np.isinf(self.kpis).all(axis=1))

    def find(self, theta: Sequence[float] | Float[np.ndarray, " n"]) -> int:
        """Return the row of a physical θ. Raises KeyError if it was not simulated."""
        return int(self.rows([theta])[0])

    def rows(self, thetas: Sequence[Sequence[float] | Float[np.ndarray, " n"]]) -> Int[np.ndarray, " p"]:
        """Return the rows of p physical θ, shape (p,). Raises KeyError if one was not simulated."""
        if not len(thetas):
            return np.zeros(0, dtype=np.int64)
        same = (self.thetas == np.array(thetas, dtype=float)[:, None]).all(axis=2)
        known = same.any(axis=1)
        if not known.all():
            raise KeyError(tuple(thetas[int(known.argmin())]))
        return np.asarray(same.argmax(axis=1))


def columns_of(outcomes: Sequence[Mapping[str, float]]) -> dict[str, Float[np.ndarray, " m"]]:
    """Return the values of each KPI of m experiments, shape (m,), by name; NaN where one lacks it."""
    names = {name for outcome in outcomes for name in outcome}
    return {name: np.array([outcome.get(name, np.nan) for outcome in outcomes]) for name in names}
