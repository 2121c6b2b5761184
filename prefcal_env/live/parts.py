"""Describe the nodes of a live plant: knobs and start values that are written, and records."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import inf, isfinite
from typing import Literal, get_args

from prefcal_env.errors import SettingsError
from prefcal_env.knobs.knob import Knob
from prefcal_env.sources.run import Change

Role = Literal["output", "input", "reference"]
_CLOSE = 1e-5
"""Relative difference of equal values: many controllers store single precision."""


@dataclass(frozen=True, slots=True)
class Written:
    """A node that prefcal may write to.

    Args:
        name: Name, as shown to people.
        node: Address of the node.
        low: Smallest value that may be written, in `unit`.
        high: Largest value that may be written, in `unit`.
        rate: Largest rate of change, in `unit` per second.
        unit: Unit of the values.
        integer: Whether only whole numbers are valid.

    Raises:
        SettingsError: If the node is empty, the limits are not finite and increasing, or the rate
            is not above 0.
    """

    name: str
    node: str
    low: float
    high: float
    rate: float
    unit: str = ""
    integer: bool = False

    def __post_init__(self) -> None:
        _check_node(self.name, self.node)
        if not (isfinite(self.low) and isfinite(self.high) and self.low < self.high):
            raise SettingsError(
                f"{self.name!r} needs finite limits low < high, got "
                f"[{self.low}, {self.high}] {self.unit}".rstrip()
            )
        if not (isfinite(self.rate) and self.rate > 0):
            raise SettingsError(
                f"{self.name!r}: rate must be above 0 {self.unit or '1'} per second and finite, "
                f"got {self.rate}"
            )

    def changed(self, old: float, new: float) -> Change:
        """Return what writing `new` in place of `old` changes, in `unit`."""
        return Change(self.name, new, old, self.unit, self.low, self.high, self.rate)

    def same(self, one: float, other: float) -> bool:
        """Return whether two values are equal up to single precision."""
        size = max(abs(one), abs(other))
        return abs(one - other) <= _CLOSE * size + 1e-9 * (self.high - self.low)

    def step(self, elapsed: float, period: float) -> float:
        """Return the largest change now, in `unit`.

        Args:
            elapsed: Time since the last change, in seconds.
            period: Sampling period in seconds. A pause does not allow a larger jump than one
                period does, except that an integer may always move by 1 once its rate allows it.
        """
        one = 1.0 if self.integer else 0.0
        allowed = min(self.rate * max(elapsed, 0.0), max(self.rate * period, one))
        # Rounding must not cost a whole number.
        return float(int(allowed + 1e-9)) if self.integer else allowed


@dataclass(frozen=True, slots=True)
class LiveKnob:
    """A knob on a live plant.

    Args:
        knob: Knob, whose range limits what is written.
        node: Address of the node, for example "ns=2;s=PI.Kp".
        rate: Largest rate of change, in the knob's unit per second.

    Raises:
        SettingsError: If the node is empty or the rate is not above 0.
    """

    knob: Knob
    node: str
    rate: float

    def __post_init__(self) -> None:
        _ = self.written

    @property
    def written(self) -> Written:
        """Return the node as one that may be written to."""
        k = self.knob
        low, high = float(k.low), float(k.high)
        return Written(k.name, self.node, low, high, self.rate, k.unit, k.integer)


@dataclass(frozen=True, slots=True)
class LiveStart(Written):
    """A value that is written to start a run, such as a set-point, and taken back at its end.

    Its name differs from the knobs' names; it may be an integer, for example of a switch.

    Args:
        value: Value that starts the run, in `unit`.

    Raises:
        SettingsError: If the value is outside the limits, or a limit or the rate is not valid.
    """

    value: float = field(kw_only=True)

    def __post_init__(self) -> None:
        Written.__post_init__(self)  # slots make a new class, which super() does not know
        if not self.low <= self.value <= self.high:
            raise SettingsError(
                f"start value {self.name!r} must be in [{self.low}, {self.high}] {self.unit}, "
                f"got {self.value}"
            )
        if self.integer and self.value != round(self.value):
            raise SettingsError(f"start value {self.name!r} must be an integer, got {self.value}")


@dataclass(frozen=True, slots=True)
class Tag:
    """A node that is recorded.

    Args:
        name: Name, as shown to people; a reference has the name of its output.
        node: Address of the node.
        role: "output", "input" or "reference".
        unit: Unit of the values.
        low: Lower limit that is drawn and counts in KPIs, in `unit`.
        high: Upper limit that is drawn and counts in KPIs, in `unit`.
        abort: Limits (low, high) in `unit`; a value outside stops the run as unsafe.

    Raises:
        SettingsError: If the node is empty, the role is unknown, or limits do not increase.
    """

    name: str
    node: str
    role: Role = "output"
    unit: str = ""
    low: float = -inf
    high: float = inf
    abort: tuple[float, float] = (-inf, inf)

    def __post_init__(self) -> None:
        _check_node(self.name, self.node)
        if self.role not in get_args(Role):
            raise SettingsError(
                f"role of {self.name!r} must be one of {', '.join(get_args(Role))}, got {self.role!r}"
            )
        for what, (low, high) in (("limits", (self.low, self.high)), ("abort", self.abort)):
            if not low < high:
                raise SettingsError(
                    f"{what} of {self.name!r} must be low < high, got [{low}, {high}] {self.unit}".rstrip()
                )

    @property
    def key(self) -> str:
        """What tells it apart: role and name."""
        return f"{self.role} {self.name}"

    @property
    def supervised(self) -> bool:
        """Whether it has an abort limit."""
        return self.abort != (-inf, inf)


def _check_node(name: str, node: object) -> None:
    if not (isinstance(node, str) and node.strip()):
        raise SettingsError(f"{name!r} needs the address of its node, got {node!r}")


def within(value: float, limits: tuple[float, float]) -> bool:
    """Return whether `value` is inside `limits`, inclusive; NaN is not."""
    return limits[0] <= value <= limits[1]


def all_within(values: Mapping[str, float], limits: Mapping[str, tuple[float, float]]) -> bool:
    """Return whether every named value is inside its limits."""
    return all(within(values[name], between) for name, between in limits.items())
