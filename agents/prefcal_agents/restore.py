"""Waking any agent up from its saved state."""

from collections.abc import Mapping
from types import MappingProxyType

from prefcal_env.errors import SettingsError
from prefcal_env.knobs import KnobSpace

from .glis import GLIS
from .glisp import GLISp
from .latin_hypercube import LatinHypercube
from .random_search import RandomSearch
from .state import AgentState

AnyAgent = GLIS | GLISp | LatinHypercube | RandomSearch

AGENTS: Mapping[str, type[AnyAgent]] = MappingProxyType(
    {"GLIS": GLIS, "GLISp": GLISp, "RandomSearch": RandomSearch, "LatinHypercube": LatinHypercube}
)
"""The agents by the name that their state bears."""


def restore(space: KnobSpace, state: AgentState) -> AnyAgent:
    """Make the agent that `state` was taken from; its next query is identical.

    An older algorithm's state is taken as it is: its samples stay, and the present algorithm
    carries on from them.

    Raises:
        SettingsError: an unknown agent, or a state that does not fit `space`.
    """
    if state.agent not in AGENTS:
        raise SettingsError(f"the agent must be one of {sorted(AGENTS)}, got {state.agent!r}")
    return AGENTS[state.agent].restore(space, state)
