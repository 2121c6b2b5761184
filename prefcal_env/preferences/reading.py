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
        if name not in self.steps:
            return values
        read = as_read(values, self.steps[name])
        return np.where(read <= self.limits[name], 0.0, read) if name in self.targets else read

    def table(self, names: Sequence[str], kpis: Float[np.ndarray, "m k"]) -> Float[np.ndarray, "m k"]:
        """Return the KPIs `names` of m experiments as people read them, shape (m, k)."""
        columns = [self(name, values) for name, values in zip(names, kpis.T, strict=True)]
        return np.array(columns).T.reshape(kpis.shape)

    def missed(self, names: Sequence[str], kpis: Float[np.ndarray, "m k"]) -> Int[np.ndarray, " m"]:
        """Return how many objectives each experiment misses, shape (m,); never counts, too."""
        most = np.array([self.limits.get(name, np.finfo(float).max) for name in names])
        return np.asarray(np.count_nonzero(kpis > most, axis=1))
