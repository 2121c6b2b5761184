"""Key performance indicators (KPIs): what they are called, when they are good, and how they are read."""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import ScenarioError

from .experiment import Experiment
from .formula import formula_of

_DIGITS = 4
"""Significant digits that a number is shown with."""


def as_read(
    values: Float[np.ndarray, "*shape"] | float, step: Float[np.ndarray, " k"] | float = 0.0
) -> Float[np.ndarray, "*shape"]:
    """Return values as they are shown: multiples of `step`, in four significant digits.

    Args:
        values: Values of a KPI, in its unit; infinite and NaN stay.
        step: Smallest difference that is shown, in the same unit; 0 if only the digits limit it. It
            may be one for each column of `values`, shape (k,).
    """
    found = np.array(values, dtype=float)
    known = np.isfinite(found) & (found != 0)
    some, steps = found[known], np.broadcast_to(step, found.shape)[known]
    some = np.where(steps == 0, some, np.round(some / np.where(steps == 0, 1.0, steps)) * steps)
    size = np.abs(np.where(some == 0, 1.0, some))
    # Integers of any size keep all their digits, and a power of 10 above 300 would overflow.
    places = 10.0 ** np.clip(_DIGITS - 1 - np.floor(np.log10(size)), 0, 300)
    found[known] = np.round(some * places) / places + 0.0
    return found


@dataclass(frozen=True, slots=True)
class KPI:
    """A key performance indicator (KPI): a number that people read off an experiment.

    Args:
        name: Key in `Experiment.kpis`.
        title: Title for people.
        unit: Unit of the values and limits.
        at_most: Largest value that meets the objective, in `unit`.
        at_least: Smallest value that meets the objective, in `unit`.
        better: Direction of improvement if there is no objective. Without a direction or an
            objective, the KPI is informational and the agent does not learn from it (for
            example, a score that a person would not write down).
        about: One sentence that explains the KPI to people.
        resolution: Smallest difference that people can see, in `unit`: values are shown, and
            simulated ones learned from, as its multiples. None for a hundredth of an objective's
            range, rounded down to a power of 10, and for 0.01 of a KPI in %; others are shown with
            four significant digits.
        formula: Formula that computes it from the signals of a run, such as "max(level) - ref(level)"
            (see docs/outcomes.md); "" if the run returns it.

    Attributes:
        goal: Direction of improvement; "target" is the middle of the objective's range; None if
            there is no direction.
        step: Smallest difference that is shown, in `unit`; 0 if only digits limit it.

    Raises:
        ScenarioError: If `better` is not "lower", "higher" or None, if `at_least` is above
            `at_most`, `resolution` is not above 0, or `formula` cannot be read.
    """

    name: str
    title: str
    unit: str = ""
    at_most: float = np.inf
    at_least: float = -np.inf
    better: Literal["lower", "higher"] | None = None
    about: str = ""
    resolution: float | None = None
    formula: str = ""
    goal: Literal["lower", "higher", "target"] | None = field(init=False, repr=False, compare=False)
    step: float = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if not isinstance(self.formula, str):
            raise ScenarioError(f"formula of KPI {self.name!r} must be a text, got {self.formula!r}")
        if self.formula:
            formula_of(self.formula)
        if self.resolution is not None and not 0 < self.resolution < np.inf:
            raise ScenarioError(
                f"resolution of KPI {self.name!r} must be above 0 and finite, "
                f"got {self.resolution} {self.unit}".rstrip()
            )
        if self.better not in ("lower", "higher", None):
            raise ScenarioError(
                f"better of KPI {self.name!r} must be lower, higher or None, got {self.better!r}"
            )
        if not self.at_least <= self.at_most:
            raise ScenarioError(
                f"KPI {self.name!r}: at_least must not be above at_most, "
                f"got {self.at_least} and {self.at_most} {self.unit}".rstrip()
            )
        object.__setattr__(self, "goal", self._goal())
        object.__setattr__(self, "step", self._step())

    def _goal(self) -> Literal["lower", "higher", "target"] | None:
        if self.better is not None:
            return self.better
        if np.isfinite(self.at_most) and np.isfinite(self.at_least):
            return "target"
        if np.isfinite(self.at_most):
            return "lower"
        return "higher" if np.isfinite(self.at_least) else None

    def _step(self) -> float:
        if self.resolution is not None:
            return self.resolution
        width = self.at_most - self.at_least
        if np.isfinite(width) and width > 0:
            return float(10.0 ** np.floor(np.log10(width / 100)))
        return 0.01 if self.unit == "%" else 0.0

    def read(self, value: float) -> float:
        """Return `value` as it is shown: in multiples of `step`, with four significant digits."""
        return float(as_read(value, self.step))

    def judged(self, value: float) -> float:
        """Return how bad `value` looks: equal for values that read the same or meet a target."""
        if self.goal == "target" and self.met(value):
            return 0.0
        return float(self.badness(self.read(value)))

    def badness(self, values: Float[np.ndarray, "*shape"] | float) -> Float[np.ndarray, "*shape"] | float:
        """Return values so that lower is better, in the same shape; NaN if one could not be measured."""
        if self.goal == "target":
            return np.abs(values - (self.at_most + self.at_least) / 2)
        found = np.negative(values) if self.goal == "higher" else values
        return np.where(np.equal(found, -np.inf), np.nan, found)[()]  # nothing is infinitely good

    def met(self, value: float) -> bool | None:
        """Return whether `value`, as read, meets the objective; None if there is no objective."""
        if np.isinf(self.at_most) and np.isinf(self.at_least):
            return None
        return bool(self.at_least <= self.read(value) <= self.at_most)

    def met_by(self, experiment: Experiment) -> bool | None:
        """Return whether an experiment meets the objective; None without one or a value."""
        value = experiment.kpis.get(self.name)
        return None if value is None else self.met(value)
