"""Provide agents that propose θ and learn from preferences or from scores.

Everything below is loaded on first use, so that listing the agents takes no time.
"""

from importlib import import_module as _import_module
from importlib.util import find_spec as _find_spec
from typing import TYPE_CHECKING as _TYPE_CHECKING
from typing import Any as _Any

from .registry import AGENTS as AGENTS
from .registry import restore as restore

if _TYPE_CHECKING:
    from .baselines.equal_weights import EqualWeights as EqualWeights
    from .baselines.glis import GLIS as GLIS
    from .baselines.glis import GLISSettings as GLISSettings
    from .baselines.latin_hypercube import LatinHypercube as LatinHypercube
    from .baselines.random_search import RandomSearch as RandomSearch
    from .baselines.step_search import StepSearch as StepSearch
    from .glisp.agent import GLISp as GLISp
    from .glisp.settings import GLISpSettings as GLISpSettings
    from .history.agent_state import AgentState as AgentState
    from .minimize import Minimum as Minimum
    from .minimize import minimize_by_preference as minimize_by_preference
    from .protocol.agent import Agent as Agent
    from .respacing import respaced as respaced
    from .rl import PPOBandit as PPOBandit
    from .rl import SACBandit as SACBandit
    from .screening.agent import Screening as Screening
    from .screening.simulations import Simulate as Simulate
    from .screening.simulations import SimulateMany as SimulateMany
    from .transfer import Earlier as Earlier
    from .utility.bank import Bank as Bank

_HOMES = {
    "Agent": "protocol.agent",
    "AgentState": "history.agent_state",
    "Bank": "utility.bank",
    "Earlier": "transfer",
    "GLISSettings": "baselines.glis",
    "GLISpSettings": "glisp.settings",
    "Minimum": "minimize",
    "Simulate": "screening.simulations",
    "SimulateMany": "screening.simulations",
    "minimize_by_preference": "minimize",
    "respaced": "respacing",
    **{row.name: row.module for row in AGENTS if "." not in row.name},
}

__all__ = ["AGENTS", "restore", *_HOMES]


def __getattr__(name: str) -> _Any:
    if name in _HOMES:
        found = getattr(_import_module(f".{_HOMES[name]}", __name__), name)
        globals()[name] = found
        return found
    if not name.startswith("_") and _find_spec(f"{__name__}.{name}") is not None:
        return _import_module(f".{name}", __name__)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOMES})
