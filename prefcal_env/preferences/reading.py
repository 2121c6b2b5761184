"""What people read off KPIs: numbers in steps, targets reached or not, objectives met or missed.

A difference that nobody can read is none: neither for what agents learn nor for what is said.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float, Int

from prefcal_env.experiments.kpi import as_read as as_read


@dataclass(frozen=True, slots=True)
class Reading:
    """How people read the KPIs of experiments, given as agents know them: lower is better.

    Args:
        steps: Name of a KPI to the smallest difference that is shown, in its unit; 0 if only its
            four digits limit it. KPIs without a row are compared exactly.
        limits: Name of a KPI to the largest value that meets its objective.
        targets: KPIs of which all values that meet the objective are alike.
    """

    steps: Mapping[str, float] = field(default_factory=dict)
    limits: Mapping[str, float] = field(default_factory=dict)
    targets: frozenset[str] = frozenset()

    def __call__(self, name: str, values: Float[np.ndarray, " m"]) -> Float[np.ndarray, " m"]:
        """Return the values of KPI `name` as people read them, shape (m,)."""
        return self.table([name], values[:, None])[:, 0]

    def table(self, names: Sequence[str], kpis: Float[np.ndarray, "m k"]) -> Float[np.ndarray, "m k"]:
        """Return the KPIs `names` of m experiments as people read them, shape (m, k)."""
        known = [name in self.steps for name in names]
        if not any(known):
            return kpis
        read = as_read(kpis, np.array([self.steps.get(name, 0.0) for name in names]))
        read = np.where(known, read, kpis)
        alike = [name in self.targets and name in self.steps for name in names]
        limits = [self.limits[n] if one else 0.0 for n, one in zip(names, alike, strict=True)]
        return np.where(alike & (read <= limits), 0.0, read)

    def missed(self, names: Sequence[str], kpis: Float[np.ndarray, "m k"]) -> Int[np.ndarray, " m"]:
        """Return how many objectives each experiment misses, shape (m,); never counts, too."""
        most = np.array([self.limits.get(name, np.finfo(float).max) for name in names])
        return np.asarray(np.count_nonzero(kpis > most, axis=1))
