"""What varies from run to run of a verification: quantities with their ranges, and values of them."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import ceil, copysign
from typing import Literal, NamedTuple, get_args

import numpy as np
from jaxtyping import Float

from prefcal_env.arrays import is_number
from prefcal_env.errors import SettingsError
from prefcal_env.wording import did_you_mean

Kind = Literal["parameter", "dead time", "sensor", "actuator", "task"]
Values = Mapping[str, float]  # values of factors by name, in their units; those left out are nominal
Ranges = Mapping[str, float | Sequence[float]]
"""Relative changes by name or kind of factor: one number for both directions, or two.

By its name, a factor changes as given; by its kind, its usual range grows as the kind's usual change does.
"""
LeftOut = tuple[str, str]  # what is not varied, and why
UNMODELED: tuple[LeftOut, ...] = (
    ("what the model lacks, such as a resonance", "nobody stated it: the margins say how much is bearable"),
    ("other loops, also with a wrong sign", "they are not in the model"),
    ("actuators that differ up and down, or stick", "they are as modeled"),
    ("failures of sensors and actuators", "they are not simulated"),
)
"""What no factor is for, of any source."""
USUAL: Mapping[Kind, float] = {
    "parameter": 0.1,
    "dead time": 0.2,
    "sensor": 1.0,
    "actuator": 0.1,
    "task": 0.2,
}
"""Usual relative change of each kind."""
BEYOND: Mapping[Kind, str] = {"sensor": "sensors", "actuator": "actuators", "task": "task"}
"""Kinds that a robust study does not vary where no limit is stated, and their names."""
CHANGE, SIZE, NARROWER = USUAL["parameter"], USUAL["dead time"], USUAL["actuator"]
"""Relative changes: of parameters; of dead time, loads and references; of the ranges of inputs."""
LEAST = 0.01  # smallest share of its nominal value that what cannot be 0 can have
ANY, NOT_NEGATIVE = (-np.inf, np.inf), (0.0, np.inf)  # possible values of a factor

PLACES = "start", "target", "target under the load"


class Unheld(NamedTuple):
    """Where no input within its range holds a varied plant, so that no tuning can, either."""

    place: str  # one of `PLACES`
    input: str  # name of an input whose range ends
    needs: float  # what it would have to be, in its unit


@dataclass(frozen=True, slots=True)
class Factor:
    """A quantity that varies, uniformly from `low` to `high`, in `unit`.

    Args:
        name: Name for people, such as "gain of valve".
        kind: What it belongs to.
        nominal: Value of the study.
        low: Lowest value.
        high: Highest value.
        unit: Unit, or what it is a share of or multiplies, in words; "" also for a direction.
        ends: Whether it only has its lowest and its highest value, as a direction does.
        possible: Smallest and largest value that there can be.
        step: Distance of its values; 0 for any.
        stated: Whether somebody stated its range, which is the usual one otherwise.
        told: What its range follows from, if it is no usual one.
    """

    name: str
    kind: Kind
    nominal: float
    low: float
    high: float
    unit: str = ""
    ends: bool = False
    possible: tuple[float, float] = ANY
    step: float = 0.0
    stated: bool = False
    told: str = ""

    @classmethod
    def around(
        cls,
        name: str,
        kind: Kind,
        change: float | Sequence[float],
        nominal: float = 1.0,
        unit: str = "",
        possible: tuple[float, float] = ANY,
    ) -> "Factor":
        """Return the factor that changes by a share of its nominal value, or, if that is 0, by so much."""
        (down, up), size = _both(change), abs(nominal) or 1.0
        low, high = nominal + down * size, nominal + up * size
        return cls(name, kind, nominal, low, high, unit, possible=possible)

    def value(self, share: float) -> float:
        """Return the value at a share of the way from the lowest to the highest, 0 to 1."""
        if self.ends:
            return self.low if share < 0.5 else self.high
        if self.step:
            count = round((self.high - self.low) / self.step) + 1
            return self.low + self.step * min(int(share * count), count - 1)
        return self.low + share * (self.high - self.low)

    def stepped(self, step: float) -> "Factor":
        """Return the factor whose values are `step` apart: each of its ends moves away by less than that."""
        sides = (end - self.nominal for end in (self.low, self.high))
        low, high = (copysign(step * ceil(abs(side) / step - 1e-9), side) for side in sides)
        return replace(self, low=self.nominal + low, high=self.nominal + high, step=step)


def within(factors: Iterable[Factor], ranges: Ranges) -> tuple[Factor, ...]:
    """Return the factors that vary, with these relative changes in place of the usual ones.

    A name comes before its kind, and a change of 0 leaves a factor out.

    Raises:
        SettingsError: If a name is unknown, or a change is no number, has no direction or is impossible.
    """
    found = list(factors)
    known = {*(factor.name for factor in found), *get_args(Kind)}
    for name, change in ranges.items():
        if name not in known:
            raise SettingsError(
                f"nothing that varies is called {name!r}.{did_you_mean(name, known)} Expected one of "
                f"{sorted(known)}"
            )
        both = _both(change)
        if len(both) != 2 or not all(is_number(e) and np.isfinite(e) for e in both) or both[0] > both[1]:
            raise SettingsError(f"the range of {name!r} must be a number or two, low first, got {change!r}")
    changed = (_with_ranges(f, ranges) for f in found)
    return tuple(f for f in changed if f.low != f.nominal or f.high != f.nominal)


def _both(change: float | Sequence[float]) -> list[float]:
    """Return the change downwards and upwards."""
    return [-change, change] if isinstance(change, int | float) else list(change)


def _with_ranges(factor: Factor, ranges: Ranges) -> Factor:
    """Return a factor with another range, if one is given for its name or its kind."""
    named = factor.name in ranges
    change = ranges.get(factor.name, ranges.get(factor.kind))
    if change is None or (factor.ends and any(_both(change)) and not named):
        return factor
    if factor.ends and any(_both(change)):
        values = f"{factor.low:g} or {factor.high:g}"
        raise SettingsError(
            f"{factor.name!r} is {values}: only 0, which leaves it out, changes that, got {change}"
        )
    wide = Factor.around(factor.name, factor.kind, change, factor.nominal)
    low, high = wide.low, wide.high
    if not named:
        sides = factor.nominal - factor.low, factor.high - factor.nominal
        low, high = (factor.nominal + c / USUAL[factor.kind] * sides[c > 0] for c in _both(change))
    least, most = factor.possible
    if low < least or high > most:
        raise SettingsError(
            f"{factor.name!r} would be {low:.4g} to {high:.4g} {factor.unit}".rstrip()
            + f", but only {least:.4g} to {most:.4g} is possible: got a change of {change} "
            "(0:0.5 would change it upward only)"
        )
    changed = replace(factor, low=low, high=high, stated=True)
    return changed.stepped(factor.step) if factor.step else changed


def draw(factors: Sequence[Factor], seed: int, k: int) -> dict[str, float]:
    """Return the values of run k by name: independent of all other runs and of their number."""
    shares: Float[np.ndarray, " n"] = np.random.default_rng([seed, k]).random(len(factors))
    return {f.name: f.value(share) for f, share in zip(factors, shares.tolist(), strict=True)}
