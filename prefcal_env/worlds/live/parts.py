"""Describe the nodes of a live plant: knobs and start values that are written, and records."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import inf, isfinite
from typing import Any, Literal, get_args

from prefcal_env.errors import SettingsError
from prefcal_env.experiments.experiment import Channel
from prefcal_env.knobs.knob import Knob
from prefcal_env.sources.run import Change

Role = Literal["output", "input", "reference"]
_CLOSE = 1e-5
"""Relative difference of equal values: many controllers store single precision."""


@dataclass(frozen=True, slots=True)
class LiveKnob:
    """A knob on a live plant: a node that prefcal may write to.

    Args:
        knob: Knob, whose range limits what is written.
        node: Address of the node, for example "ns=2;s=PI.Kp".
        rate: Largest rate of change, in the knob's unit per second.

    Raises:
        SettingsError: If the node is empty, or the rate is not above 0 and finite.
    """

    knob: Knob
    node: str
    rate: float

    def __post_init__(self) -> None:
        _check_node(self.knob.name, self.node)
        if not (isfinite(self.rate) and self.rate > 0):
            raise SettingsError(
                f"{self.knob.name!r}: rate must be above 0 {self.knob.unit or '1'} per second and finite, "
                f"got {self.rate}"
            )

    def changed(self, old: float, new: float) -> Change:
        """Return what writing `new` in place of `old` changes, in the knob's unit."""
        return Change(self.knob, new, old, self.rate)

    def same(self, one: float, other: float) -> bool:
        """Return whether two values are equal up to single precision."""
        size = max(abs(one), abs(other))
        return abs(one - other) <= _CLOSE * size + 1e-9 * (self.knob.high - self.knob.low)

    def step(self, elapsed: float, period: float) -> float:
        """Return the largest change now, in the knob's unit.

        Args:
            elapsed: Time since the last change, in seconds.
            period: Sampling period in seconds. A pause does not allow a larger jump than one
                period does, except that an integer may always move by 1 once its rate allows it.
        """
        one = 1.0 if self.knob.integer else 0.0
        allowed = min(self.rate * max(elapsed, 0.0), max(self.rate * period, one))
        # Rounding must not cost a whole number.
        return float(int(allowed + 1e-9)) if self.knob.integer else allowed


@dataclass(frozen=True, slots=True)
class LiveStart(LiveKnob):
    """A knob that is not tuned: it is written to start a run, and taken back at its end.

    Its name, for example "set-point", differs from the knobs' names; an integer may be a switch.

    Args:
        value: Value that starts the run, in the knob's unit.

    Raises:
        SettingsError: If the value is outside the knob's range, or as for a `LiveKnob`.
    """

    value: float = field(kw_only=True)

    def __post_init__(self) -> None:
        LiveKnob.__post_init__(self)  # slots make a new class, which super() does not know
        knob = self.knob
        if not knob.low <= self.value <= knob.high:
            raise SettingsError(
                f"start value {knob.name!r} must be in [{knob.low}, {knob.high}] {knob.unit}, "
                f"got {self.value}"
            )
        if knob.integer and self.value != round(self.value):
            raise SettingsError(f"start value {knob.name!r} must be an integer, got {self.value}")


@dataclass(frozen=True, slots=True, kw_only=True, init=False)
class Tag(Channel):
    """A channel that is recorded: where it is on the plant, and its role.

    Args:
        name: Name, as shown to people; a reference has the name of its output.
        node: Address of the node.
        role: "output", "input" or "reference".
        unit: Unit of the values.
        low: Lower limit that is drawn and counts in KPIs, in `unit`.
        high: Upper limit that is drawn and counts in KPIs, in `unit`.
        abort: Limits (low, high) in `unit`; a value outside stops the run as unsafe.
        look: Target, band and symbol of the `Channel`; they are not drawn of a live plant.

    Raises:
        SettingsError: If the node is empty, the role is unknown, or limits do not increase.
    """

    node: str
    role: Role
    abort: tuple[float, float]

    def __init__(
        self,
        name: str,
        node: str,
        role: Role = "output",
        unit: str = "",
        low: float = -inf,
        high: float = inf,
        abort: tuple[float, float] = (-inf, inf),
        **look: Any,
    ) -> None:
        _check_node(name, node)
        if role not in get_args(Role):
            raise SettingsError(f"role of {name!r} must be one of {', '.join(get_args(Role))}, got {role!r}")
        for what, between in (("limits", (low, high)), ("abort", abort)):
            if not between[0] < between[1]:
                raise SettingsError(
                    f"{what} of {name!r} must be low < high, got [{between[0]}, {between[1]}] {unit}".rstrip()
                )
        Channel.__init__(self, name, unit, low, high, **look)
        object.__setattr__(self, "node", node)
        object.__setattr__(self, "role", role)
        object.__setattr__(self, "abort", abort)

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
