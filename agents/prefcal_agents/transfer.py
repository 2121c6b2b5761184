"""Start from earlier work: the best θ of another study, or the same study in a changed space."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from prefcal_env.errors import KnobError, SettingsError
from prefcal_env.knobs import Knob, KnobSpace
from prefcal_env.knobs import respaced as respaced_space
from prefcal_env.preferences.history import Sample
from prefcal_env.units import conversion

from .agent import Agent, AgentState
from .registry import CLASSES, restore
from .screening.bank import Simulate


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
            KnobError: If a knob has no value, or a unit that its earlier one does not convert to.
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
        try:
            values = {name: float(value) for name, value in added.items()}
        except (TypeError, ValueError) as error:
            raise KnobError(f"added must hold numbers, got {added!r}") from error
        for before, value in zip(self.knobs, self.best, strict=True):
            now = next((knob for knob in space if knob.name == before.name), before)
            found = conversion(before.unit, now.unit)
            # Whether a temperature is a difference, a knob does not say.
            if found is None or found.offset:
                was = f"was in {before.unit!r} in the earlier study"
                raise KnobError(f"knob {now.name!r} {was}, and is in {now.unit!r} now")
            values[before.name] = found.to(value)
        return [values[name] for name in space.names]


def _nearest(knob: Knob, value: float, within: tuple[float, float]) -> float:
    """Return the value nearest to `value` that `knob` may take."""
    return float(np.clip(np.floor(value + 0.5) if knob.integer else value, *within))


# --- Move a running agent to a changed space without losing what it has learned.

RESPACEABLE = frozenset(name for name, row in CLASSES.items() if not row.extra)
"""Agents that can continue in a changed space; those of other packages cannot."""


def respaced(
    agent: Agent,
    new: KnobSpace,
    *,
    added: Mapping[str, float] | None = None,
    keep_open: bool = True,
    simulate: Simulate | None = None,
) -> Agent:
    """Return an agent with the samples and answers of `agent` that searches `new`.

    Its space includes every sample, so it still learns from those outside a narrowed range, and no
    θ runs again. `agent` itself does not change.

    Args:
        agent: Agent of this package.
        new: Space with all knobs of the agent's space, the range to search of each, and any
            additional knobs.
        added: Maps each additional knob to its physical value in the experiments so far.
        keep_open: Whether the open query keeps its sample, which may have run already.
        simulate: Function that simulates a θ of `new`, for an agent that needs one. None keeps the
            agent's own, unless the knobs or their order change: then it could misread θ.

    Raises:
        KnobError: As in `prefcal_env.knobs.respaced`.
        SettingsError: If the agent cannot be restricted.
    """
    # Its state settles what is open, so the open experiment stays the one that may be running.
    state = agent.state
    if state.agent not in RESPACEABLE:
        raise SettingsError(f"only the agents {sorted(RESPACEABLE)} can change their space")
    space = respaced_space(agent.space, new, added)
    if not keep_open:
        kept = state.history.samples[: state.history.answered]
        state = replace(state, history=replace(state.history, samples=kept))
    if simulate is None and space.names == agent.space.names:
        simulate = getattr(agent, "simulate", None)
    return restore(space, move(state, agent.space, space, added), simulate=simulate)


def move(
    state: AgentState, old: KnobSpace, new: KnobSpace, added: Mapping[str, float] | None = None
) -> AgentState:
    """Return `state`, of an agent in the space `old`, for the space `new`.

    Raises:
        KnobError: If `new` does not hold every sample, or has a knob without a value.
    """
    # Given θ are points of the old cube; in the new one they lie elsewhere.
    start = [Sample.of(old, np.array(z)).moved(old, new, added).z for z in state.start]
    history = state.history.moved(old, new, added)
    return replace(state, history=history, start=tuple(start))
