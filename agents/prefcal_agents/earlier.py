"""Warm start from an earlier study: of another person, or of a similar plant."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import KnobError, SettingsError
from prefcal_env.knobs import Knob, KnobSpace
from prefcal_env.preference import Preference

from .checks import integer
from .ledger import Ledger
from .state import AgentState

PLACES = 1
"""θ that are taken over unless said otherwise; measured in docs/research/warm_start.md."""
APART = 0.1
"""Root mean square distance per knob, in the unit cube, from which on two θ are distinct."""


class HasState(Protocol):
    """Any agent of this package."""

    @property
    def space(self) -> KnobSpace:
        """Its knobs."""

    @property
    def state(self) -> AgentState:
        """Its state."""


@dataclass(frozen=True, slots=True)
class Earlier:
    """What an earlier study found, in physical units, so that its space need not be this one.

    Args:
        knobs: Its knobs, in order.
        winners: Physical θ, each of length len(knobs), that were its best at a time, the last
            one first: by the answers that stand. θ 0 is the best of all.

    Raises:
        SettingsError: nothing was found, or a θ of another length.
    """

    knobs: tuple[Knob, ...]
    winners: tuple[tuple[float, ...], ...]

    def __post_init__(self) -> None:
        if not self.winners:
            raise SettingsError("the earlier study has no answered experiment yet")
        if any(len(theta) != len(self.knobs) for theta in self.winners):
            raise SettingsError(f"each of its θ must have {len(self.knobs)} values")

    @classmethod
    def of(cls, agent: HasState) -> "Earlier":
        """What `agent` has found so far. Raises SettingsError before its first answer."""
        return cls.recorded(agent.space, agent.state.ledger)

    @classmethod
    def recorded(cls, space: KnobSpace, ledger: Ledger) -> "Earlier":
        """What a ledger over `space` says. Raises SettingsError if it holds no answer."""
        thetas = [space.decode(np.array(ledger.samples[i])) for i in _winners(ledger)]
        return cls(space.knobs, tuple(tuple(map(float, theta)) for theta in thetas))

    def start(
        self,
        space: KnobSpace,
        *,
        count: int = PLACES,
        added: Mapping[str, float] | None = None,
    ) -> tuple[tuple[float, ...], ...]:
        """The best θ and the next distinct ones as θ of `space`, for the `start` of an agent.

        Knobs are matched by name, and those that `space` lacks are dropped. A value outside of
        what is searched becomes the nearest one inside, a fraction for an integer knob the
        nearest integer; a θ that the constraints then refuse is left out.

        Args:
            space: Of the new study.
            count: Most θ, 1 or more; fewer where fewer are distinct (`APART`).
            added: Physical value of each knob of `space` that the earlier study did not have.

        Returns:
            Physical θ, each of length len(space), the best one first; perhaps none.

        Raises:
            KnobError: a knob without a value, or with another unit than it had.
            SettingsError: an impossible count.
        """
        integer("count", count, low=1)
        found: list[tuple[float, ...]] = []
        points: list[Float[np.ndarray, " n"]] = []
        for values in self._values(space, dict(added or {})):
            theta = np.array(list(map(_nearest, space, values, space.within)))
            z = space.encode(theta)
            distinct = all(_distance(z, p) > APART for p in points)
            if distinct and space.allows(theta):
                found.append(tuple(map(float, theta)))
                points.append(z)
        return tuple(found[:count])

    def missing(self, space: KnobSpace, added: Mapping[str, float]) -> list[str]:
        """Knobs of `space` that neither the earlier study nor `added` has a value of."""
        known = {*added, *(knob.name for knob in self.knobs)}
        return [name for name in space.names if name not in known]

    def _values(self, space: KnobSpace, added: Mapping[str, float]) -> list[list[float]]:
        """The winners with the knobs of `space`, in its order."""
        before = {knob.name: knob for knob in self.knobs}
        missing = self.missing(space, added)
        if missing:
            raise KnobError(f"the earlier study has no knobs {missing}: their values are needed")
        for knob in space:
            unit = before[knob.name].unit if knob.name in before else knob.unit
            if unit != knob.unit:
                raise KnobError(
                    f"knob {knob.name!r} was in {unit!r} in the earlier study, and is in "
                    f"{knob.unit!r} now"
                )
        position = {knob.name: k for k, knob in enumerate(self.knobs)}
        try:
            values = {name: float(value) for name, value in added.items()}
        except (TypeError, ValueError) as error:
            raise KnobError(f"added must hold numbers, got {added!r}") from error
        return [
            [theta[position[n]] if n in position else values[n] for n in space.names]
            for theta in self.winners
        ]


def _winners(ledger: Ledger) -> list[int]:
    """Samples that were the best so far, the last one first."""
    scored, values = ledger.scores()
    if len(scored):
        better = values == np.minimum.accumulate(values)
        return [int(i) for i in scored[better]][::-1]
    won = [
        c.challenger
        for c in ledger.comparisons
        if c.teaches and c.answer.preference is Preference.CHALLENGER
    ]
    return [*won[::-1], 0] if ledger.comparisons else []


def _nearest(knob: Knob, value: float, within: tuple[float, float]) -> float:
    """The value nearest to `value` that `knob` may take."""
    return float(np.clip(np.floor(value + 0.5) if knob.integer else value, *within))


def _distance(a: Float[np.ndarray, " n"], b: Float[np.ndarray, " n"]) -> float:
    return float(np.sqrt(np.mean((a - b) ** 2)))
