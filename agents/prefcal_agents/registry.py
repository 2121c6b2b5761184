"""Restore any agent from its saved state."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING

from prefcal_agents.baselines.glis import GLIS
from prefcal_agents.baselines.latin_hypercube import LatinHypercube
from prefcal_agents.baselines.random_search import RandomSearch
from prefcal_agents.glisp.agent import GLISp
from prefcal_agents.history.agent_state import AgentState
from prefcal_env.errors import SettingsError
from prefcal_env.knobs.knob import KnobSpace

from .optional import OPTIONAL, optional

if TYPE_CHECKING:
    from .peers import OptunaPreferential, ReferenceGLIS, ReferenceGLISp
    from .rl import PPOBandit, SACBandit

    Optional = OptunaPreferential | ReferenceGLIS | ReferenceGLISp | PPOBandit | SACBandit
    AnyAgent = GLIS | GLISp | LatinHypercube | RandomSearch | Optional
else:
    AnyAgent = GLIS | GLISp | LatinHypercube | RandomSearch

AGENTS: Mapping[str, type[GLIS | GLISp | LatinHypercube | RandomSearch]] = MappingProxyType(
    {"GLIS": GLIS, "GLISp": GLISp, "RandomSearch": RandomSearch, "LatinHypercube": LatinHypercube}
)
"""The agents by the name that their state bears; those of the extras are in `OPTIONAL`."""


def restore(space: KnobSpace, state: AgentState) -> AnyAgent:
    """Return the agent that `state` was taken from; its next query is identical.

    An older algorithm's state is taken as it is: its samples stay, and the present algorithm
    carries on from them.

    Raises:
        SettingsError: an unknown agent, or a state that does not fit `space`.
        MissingExtraError: an agent of an extra that is not installed.
    """
    if state.agent in OPTIONAL:
        agent: AnyAgent = optional(state.agent).restore(space, state)
        return agent
    if state.agent not in AGENTS:
        known = sorted([*AGENTS, *OPTIONAL])
        raise SettingsError(f"the agent must be one of {known}, got {state.agent!r}")
    return AGENTS[state.agent].restore(space, state)
