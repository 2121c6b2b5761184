"""Known constraints on θ: what is not even tried, because somebody knows that it cannot work."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from math import isfinite
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import KnobError

Values = Mapping[str, Any]
"""Knob name to physical value: a number, or for a `vectorised` constraint an array (m,)."""
_ROUNDING = 1e-12  # relative to the terms of a linear constraint: 0.1 + 0.2 is not above 0.3


@dataclass(frozen=True, slots=True)
class Constraint:
    """θ is allowed where `g` is 0 or less, NaN is not allowed.

    Args:
        name: For error messages and study files, which hold no code.
        g: Of a mapping from knob name to physical value; in any unit, best of about the same
            size for all θ near the edge.
        vectorised: Whether `g` may be called with arrays, one value for each of m θ; that is
            faster, and needs numpy's functions in place of max, abs, if and math.

    Raises:
        KnobError: no name, or a `g` that is not callable.
    """

    name: str
    g: Callable[[Values], Any]
    vectorised: bool = False

    def __post_init__(self) -> None:
        _check_name(self.name)
        if not callable(self.g):
            raise KnobError(
                f"constraint {self.name!r}: g must be a function of a mapping from knob name to "
                f"value, got {self.g!r}"
            )

    def check_names(self, names: tuple[str, ...]) -> None:
        """Accept any knobs: what `g` reads is seen when it is called."""

    def __call__(self, values: Mapping[str, Float[np.ndarray, " m"]]) -> Float[np.ndarray, " m"]:
        """g at m θ, given as one array (m,) for each knob; shape (m,).

        Raises:
            KnobError: `g` raised an error, or returned something that is not a number for each θ.
        """
        count = len(next(iter(values.values())))
        result = self._called(values) if self.vectorised else self._one_by_one(values)
        if result.shape not in ((), (count,)):
            raise KnobError(
                f"constraint {self.name!r} must give one number for each θ, which is allowed "
                f"where it is 0 or less, got shape {result.shape} for {count} θ"
            )
        return np.broadcast_to(result, (count,))

    def _one_by_one(self, values: Mapping[str, Float[np.ndarray, " m"]]) -> np.ndarray:
        # Python's own numbers: what people write compares them, and they read well in errors.
        columns = [np.asarray(column).tolist() for column in values.values()]
        rows = (dict(zip(values, row, strict=True)) for row in zip(*columns, strict=True))
        return np.array([self._called(row) for row in rows], dtype=float)

    def _called(self, values: Values) -> np.ndarray:
        try:
            return np.asarray(self.g(values), dtype=float)
        except Exception as error:
            raise KnobError(
                f"constraint {self.name!r} cannot be computed at {dict(values)}: "
                f"{type(error).__name__}: {error}"
            ) from error


@dataclass(frozen=True, slots=True, init=False)
class LinearConstraint:
    """Σ coefficient · knob <= at_most, in physical units.

    Args:
        name: For error messages and study files.
        coefficients: Knob name to coefficient; knobs that are not named do not count.
        at_most: The bound.

    Raises:
        KnobError: no name, no coefficient, or a number that is not finite.
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
            numeric = isinstance(value, (int, float, np.integer, np.floating))
            if not numeric or isinstance(value, bool) or not isfinite(value):
                raise KnobError(
                    f"constraint {name!r}: {what} must be a finite number, got {value!r}"
                )
        object.__setattr__(self, "name", name)
        pairs = tuple((knob, float(c)) for knob, c in coefficients.items())
        object.__setattr__(self, "coefficients", pairs)
        object.__setattr__(self, "at_most", float(at_most))

    def check_names(self, names: tuple[str, ...]) -> None:
        """Raise KnobError if a coefficient is of no knob among `names`."""
        strangers = [knob for knob, _ in self.coefficients if knob not in names]
        if strangers:
            raise KnobError(
                f"constraint {self.name!r} names {strangers}, which are not among the knobs {names}"
            )

    def __call__(self, values: Mapping[str, Float[np.ndarray, " m"]]) -> Float[np.ndarray, " m"]:
        """Left side less the bound at m θ, given as one array (m,) for each knob; shape (m,)."""
        terms = np.array([c * values[knob] for knob, c in self.coefficients])
        largest = np.maximum(np.max(np.abs(terms), axis=0), abs(self.at_most))
        return np.asarray(np.sum(terms, axis=0) - self.at_most - _ROUNDING * largest)


AnyConstraint = Constraint | LinearConstraint


def _check_name(name: object) -> None:
    if not (isinstance(name, str) and name.strip()):
        raise KnobError(f"a constraint needs a name, got {name!r}")


def checked(constraints: object, names: tuple[str, ...]) -> tuple[AnyConstraint, ...]:
    """Return `constraints` on knobs called `names`. Raises KnobError if they are none."""
    if isinstance(constraints, str) or not isinstance(constraints, Iterable):
        raise KnobError(f"constraints must be a sequence of them, got {constraints!r}")
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
