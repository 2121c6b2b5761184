"""Start a study from the best θ of an earlier one, by another person or on a similar plant."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from prefcal_agents.protocol.agent import Agent
from prefcal_env.errors import KnobError, SettingsError
from prefcal_env.knobs.knob import Knob
from prefcal_env.knobs.space import KnobSpace


@dataclass(frozen=True, slots=True)
class Earlier:
    """Best θ of an earlier study, in physical units: its space may differ from the new one.

    How much this helps: docs/research/archive.md.

    Args:
        knobs: Knobs of the earlier study, in order.
        best: Its best θ, one physical value for each knob.

    Raises:
        SettingsError: If `best` has another length.
    """

    knobs: tuple[Knob, ...]
    best: tuple[float, ...]

    def __post_init__(self) -> None:
        if len(self.best) != len(self.knobs):
            raise SettingsError(f"its best θ must have {len(self.knobs)} values, got {self.best}")

    @classmethod
    def of(cls, agent: Agent) -> "Earlier":
        """Return the best that `agent` has found. Raises SettingsError before its first answer."""
        if agent.best_index is None:
            raise SettingsError("the earlier study has no answered experiment yet")
        return cls(agent.space.knobs, tuple(map(float, agent.best)))

    def start(
        self, space: KnobSpace, *, added: Mapping[str, float] | None = None
    ) -> tuple[float, ...] | None:
        """Return the best θ as a θ of `space`, for the `start` of an agent.

        Knobs are matched by name; knobs that `space` lacks are dropped. A value outside the
        searched range becomes the nearest value inside, and a fraction for an integer knob the
        nearest integer.

        Args:
            space: Knobs of the new study.
            added: Physical value of each knob of `space` that the earlier study did not have.

        Returns:
            Physical θ of length len(space); None if the constraints refuse it.

        Raises:
            KnobError: If a knob has no value, or another unit than it had.
        """
        values = self._values(space, dict(added or {}))
        theta = np.array(list(map(_nearest, space, values, space.within)))
        return tuple(map(float, theta)) if space.allows(space.check(theta)) else None

    def missing(self, space: KnobSpace, added: Mapping[str, float]) -> list[str]:
        """Return the knobs of `space` that neither the earlier study nor `added` has."""
        known = {*added, *(knob.name for knob in self.knobs)}
        return [name for name in space.names if name not in known]

    def _values(self, space: KnobSpace, added: Mapping[str, float]) -> list[float]:
        """Return the values of the knobs of `space`, in its order."""
        missing = self.missing(space, added)
        if missing:
            raise KnobError(f"the earlier study has no knobs {missing}: their values are needed")
        before = {knob.name: knob for knob in self.knobs}
        for knob in space:
            unit = before[knob.name].unit if knob.name in before else knob.unit
            if unit != knob.unit:
                raise KnobError(
                    f"knob {knob.name!r} was in {unit!r} in the earlier study, and is in {knob.unit!r} now"
                )
        try:
            values = {name: float(value) for name, value in added.items()}
        except (TypeError, ValueError) as error:
            raise KnobError(f"added must hold numbers, got {added!r}") from error
        values.update(zip(before, self.best, strict=True))
        return [values[name] for name in space.names]


def _nearest(knob: Knob, value: float, within: tuple[float, float]) -> float:
    """Return the value nearest to `value` that `knob` may take."""
    return float(np.clip(np.floor(value + 0.5) if knob.integer else value, *within))
