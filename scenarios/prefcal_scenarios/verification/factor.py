"""One thing that varies from run to run of a verification."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import SettingsError
from prefcal_env.knobs.knob import is_number
from prefcal_env.wording import did_you_mean

Kind = Literal["parameter", "dead time", "sensor", "actuator", "task"]
KINDS: tuple[Kind, ...] = ("parameter", "dead time", "sensor", "actuator", "task")
Values = Mapping[str, float]
"""Values of factors by name, in their units; those left out are nominal."""
Ranges = Mapping[str, float | Sequence[float]]
"""Relative changes by name or kind of factor: one number for both directions, or two."""


@dataclass(frozen=True, slots=True)
class Factor:
    """A quantity that varies, uniformly from `low` to `high`, in `unit`.

    Args:
        name: Name for people, such as "gain of valve".
        kind: What it belongs to, one of `KINDS`.
        nominal: Value of the study.
        low: Lowest value.
        high: Highest value.
        unit: Unit; "" also for a factor by which something is multiplied.
        ends: Whether it only has its lowest and its highest value, as a direction does.
    """

    name: str
    kind: Kind
    nominal: float
    low: float
    high: float
    unit: str = ""
    ends: bool = False

    @classmethod
    def around(
        cls, name: str, kind: Kind, change: float | Sequence[float], nominal: float = 1.0, unit: str = ""
    ) -> "Factor":
        """Return the factor that changes by a share of its nominal value, or, if that is 0, by so much."""
        down, up = (-change, change) if isinstance(change, int | float) else change
        size = abs(nominal) or 1.0
        return cls(name, kind, nominal, nominal + down * size, nominal + up * size, unit)

    def value(self, share: float) -> float:
        """Return the value at a share of the way from the lowest to the highest, 0 to 1."""
        if self.ends:
            return self.low if share < 0.5 else self.high
        return self.low + share * (self.high - self.low)


def chosen(
    factors: Iterable[Factor], ranges: Ranges | None, vary: Collection[str] | None
) -> tuple[Factor, ...]:
    """Return the factors that vary.

    Args:
        factors: All that can vary.
        ranges: Relative changes in place of the usual ones; 0 leaves a factor out.
        vary: Kinds or names of the factors to vary; None for all.

    Raises:
        SettingsError: If a name is unknown, or a change is no number or has no direction.
    """
    all_ = list(factors)
    known = {factor.name for factor in all_} | set(KINDS)
    for name in (*(ranges or ()), *(vary or ())):
        if name not in known:
            raise SettingsError(
                f"nothing that varies is called {name!r}.{did_you_mean(name, known)} Expected one of "
                f"{sorted(known)}"
            )
    found = []
    for factor in all_:
        if vary is not None and not {factor.name, factor.kind} & set(vary):
            continue
        change = (ranges or {}).get(factor.name, (ranges or {}).get(factor.kind))
        kept = factor if change is None else _changed(factor, change)
        if kept.low != kept.nominal or kept.high != kept.nominal:
            found.append(kept)
    return tuple(found)


def _changed(factor: Factor, change: float | Sequence[float]) -> Factor:
    both = [change, change] if isinstance(change, int | float) else list(change)
    if len(both) != 2 or not all(is_number(each) and np.isfinite(each) for each in both):
        raise SettingsError(f"the range of {factor.name!r} must be one or two numbers, got {change!r}")
    if (isinstance(change, int | float) and change < 0) or both[0] > both[1]:
        raise SettingsError(f"the range of {factor.name!r} must go from low to high, got {change!r}")
    wide = Factor.around(factor.name, factor.kind, change, factor.nominal, factor.unit)
    return replace(factor, low=wide.low, high=wide.high)


def drawn(factors: Sequence[Factor], seed: int, k: int) -> Float[np.ndarray, " n"]:
    """Return the values of run k, shape (n,): independent of all other runs and of their number."""
    shares = np.random.default_rng([seed, k]).random(len(factors))
    return np.array([f.value(s) for f, s in zip(factors, shares.tolist(), strict=True)])
