"""What people read off KPIs: numbers in steps, targets reached or not, objectives met or missed.

A difference that nobody can read is none: neither for what agents learn nor for what is said.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float, Int

_DIGITS = 4
"""Significant digits that a number is shown with."""


def as_read(values: Float[np.ndarray, "*shape"] | float, step: float = 0.0) -> Float[np.ndarray, "*shape"]:
    """Return values as they are shown: multiples of `step`, in four significant digits.

    Args:
        values: Values of a KPI, in its unit; infinite and NaN stay.
        step: Smallest difference that is shown, in the same unit; 0 if only the digits limit it.
    """
    found = np.array(values, dtype=float)
    known = np.isfinite(found) & (found != 0)
    some = np.round(found[known] / step) * step if step else found[known]
    size = np.abs(np.where(some == 0, 1.0, some))
    # Integers of any size keep all their digits, and a power of 10 above 300 would overflow.
    places = 10.0 ** np.clip(_DIGITS - 1 - np.floor(np.log10(size)), 0, 300)
    found[known] = np.round(some * places) / places + 0.0
    return found


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
