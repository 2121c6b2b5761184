"""Move a running agent to a changed space without losing what it has learned."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from prefcal_agents.history.agent_state import AgentState
from prefcal_agents.protocol.agent import Agent
from prefcal_env.errors import SettingsError
from prefcal_env.knobs.change import respaced as respaced_space
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.preferences.history import Sample

from .registry import CLASSES, restore
from .screening.simulations import Simulate

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
        KnobError: As in `prefcal_env.knobs.change.respaced`.
        SettingsError: If the agent cannot be restricted.
    """
    state = agent.state
    if state.agent not in RESPACEABLE:
        raise SettingsError(f"only the agents {sorted(RESPACEABLE)} can change their space")
    space = respaced_space(agent.space, new, added)
    if not keep_open:
        kept = state.history.samples[: state.history.answered]
        state = replace(state, history=replace(state.history, samples=kept))
    if simulate is None and space.names == agent.space.names:
        simulate = getattr(agent, "simulate", None)
    return restore(space, moved(state, agent.space, space, added), simulate=simulate)


def moved(
    state: AgentState, old: KnobSpace, new: KnobSpace, added: Mapping[str, float] | None = None
) -> AgentState:
    """Return `state`, of an agent in the space `old`, for the space `new`.

    Raises:
        KnobError: If `new` does not hold every sample, or has a knob without a value.
    """
    start = [Sample.of(old, np.array(z)).moved(old, new, added).z for z in state.start]
    history = state.history.moved(old, new, added)
    return replace(state, history=history, start=tuple(start))
