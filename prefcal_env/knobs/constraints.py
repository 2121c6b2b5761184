"""Known constraints on θ: rule out experiments that are known not to work."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from math import isfinite
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import KnobError

from .knob import is_number

Values = Mapping[str, Any]
"""Maps a knob name to its physical value: a number, or an array (m,) if `vectorized`."""
_ROUNDING = 1e-12  # relative to the terms of a linear constraint: accept 0.1 + 0.2 <= 0.3


@dataclass(frozen=True, slots=True)
class Constraint:
    """A constraint that allows θ where `g` is 0 or less; where `g` is NaN, θ is not allowed.

    Args:
        name: Name for error messages and study files, which hold no code.
        g: Function of a mapping from knob name to physical value. Its unit is up to you; the search
            works best if its values near the boundary are of similar size for all θ.
        vectorized: Whether `g` accepts arrays, one value for each of m θ. This is faster, but `g`
            must use numpy's functions in place of max, abs, if and math.

    Raises:
        KnobError: If the name is empty or `g` is not callable.
    """

    name: str
    g: Callable[[Values], Any]
    vectorized: bool = False

    def __post_init__(self) -> None:
        _check_name(self.name)
        if not callable(self.g):
            raise KnobError(
                f"constraint {self.name!r}: g must be a function of a mapping from knob name to "
                f"value, got {self.g!r}"
            )

    def check_names(self, names: tuple[str, ...]) -> None:
        """Accept any knob names: which ones `g` reads is known only when it is called."""

    def __call__(self, values: Mapping[str, Float[np.ndarray, " m"]]) -> Float[np.ndarray, " m"]:
        """Return g at m θ, given as one array (m,) for each knob; shape (m,).

        Raises:
            KnobError: If `g` raises an error or does not return one number for each θ.
        """
        count = len(next(iter(values.values())))
        result = self._called(values) if self.vectorized else self._one_by_one(values)
        if result.shape not in ((), (count,)):
            raise KnobError(
                f"constraint {self.name!r} must return one number for each θ (0 or less "
                f"where θ is allowed), got shape {result.shape} for {count} θ"
            )
        return np.broadcast_to(result, (count,))

    def _one_by_one(self, values: Mapping[str, Float[np.ndarray, " m"]]) -> np.ndarray:
        # Plain Python numbers: user code compares them, and they are readable in error messages.
        columns = [np.asarray(column).tolist() for column in values.values()]
        rows = (dict(zip(values, row, strict=True)) for row in zip(*columns, strict=True))
        return np.array([self._called(row) for row in rows], dtype=float)

    def _called(self, values: Values) -> np.ndarray:
        try:
            return np.asarray(self.g(values), dtype=float)
        except Exception as error:  # the user's own function can raise anything
            raise KnobError(
                f"constraint {self.name!r} cannot be computed at {dict(values)}: "
                f"{type(error).__name__}: {error}"
            ) from error


@dataclass(frozen=True, slots=True, init=False)
class LinearConstraint:
    """A linear constraint in physical units: Σ coefficient · knob <= at_most.

    Args:
        name: Name for error messages and study files.
        coefficients: Maps a knob name to its coefficient; other knobs have coefficient 0.
        at_most: Upper bound.

    Raises:
        KnobError: If the name is empty, there is no coefficient, or a number is not finite.
    """

    name: str
    coefficients: tuple[tuple[str, float], ...]
    at_most: float

    def __init__(self, name: str, coefficients: Mapping[str, float], at_most: float) -> None:
        _check_name(name)
        if not isinstance(coefficients, Mapping) or not coefficients:
            raise KnobError(
                f"constraint {name!r}: coefficients must map one or more knob names to numbers, "
                f"got {coefficients!r}"
            )
        for what, value in [*coefficients.items(), ("at_most", at_most)]:
            if not is_number(value) or not isfinite(value):
                raise KnobError(f"constraint {name!r}: {what} must be a finite number, got {value!r}")
        object.__setattr__(self, "name", name)
        pairs = tuple((knob, float(c)) for knob, c in coefficients.items())
        object.__setattr__(self, "coefficients", pairs)
        object.__setattr__(self, "at_most", float(at_most))

    def check_names(self, names: tuple[str, ...]) -> None:
        """Raise KnobError if a coefficient belongs to a knob that is not in `names`."""
        strangers = [knob for knob, _ in self.coefficients if knob not in names]
        if strangers:
            raise KnobError(
                f"constraint {self.name!r} names {strangers}, which are not among the knobs {names}"
            )

    def __call__(self, values: Mapping[str, Float[np.ndarray, " m"]]) -> Float[np.ndarray, " m"]:
        """Return left side minus bound at m θ, given as one array (m,) for each knob; (m,)."""
        terms = np.array([c * values[knob] for knob, c in self.coefficients])
        largest = np.maximum(np.max(np.abs(terms), axis=0), abs(self.at_most))
        return np.asarray(np.sum(terms, axis=0) - self.at_most - _ROUNDING * largest)


AnyConstraint = Constraint | LinearConstraint


def _check_name(name: object) -> None:
    if not (isinstance(name, str) and name.strip()):
        raise KnobError(f"a constraint needs a name, got {name!r}")


def checked(constraints: object, names: tuple[str, ...]) -> tuple[AnyConstraint, ...]:
    """Return `constraints` as a tuple. Raises KnobError if they do not fit the knobs `names`."""
    if isinstance(constraints, str) or not isinstance(constraints, Iterable):
        raise KnobError(f"constraints must be a sequence of constraints, got {constraints!r}")
    found: tuple[AnyConstraint, ...] = tuple(constraints)
    for constraint in found:
        if not isinstance(constraint, (Constraint, LinearConstraint)):
            raise KnobError(f"expected a Constraint or a LinearConstraint, got {constraint!r}")
        constraint.check_names(names)
    titles = [constraint.name for constraint in found]
    duplicates = {title for title in titles if titles.count(title) > 1}
    if duplicates:
        raise KnobError(f"constraint names must differ, got {sorted(duplicates)} more than once")
    return found
