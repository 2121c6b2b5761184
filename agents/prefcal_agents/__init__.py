"""Provide agents that propose θ and learn from preferences or from scores.

Agents that need an extra (`optional.OPTIONAL`) are loaded on first use.
"""

from typing import TYPE_CHECKING as _TYPE_CHECKING
from typing import Any as _Any

from prefcal_agents.advice.stopping import Advice as Advice
from prefcal_agents.advice.transfer import Earlier as Earlier
from prefcal_agents.baselines.glis import GLIS as GLIS
from prefcal_agents.baselines.glis_settings import GLISSettings as GLISSettings
from prefcal_agents.baselines.latin_hypercube import LatinHypercube as LatinHypercube
from prefcal_agents.baselines.random_search import RandomSearch as RandomSearch
from prefcal_agents.glisp.agent import GLISp as GLISp
from prefcal_agents.glisp.settings import GLISpSettings as GLISpSettings
from prefcal_agents.history.agent_state import AgentState as AgentState

from .minimize import Minimum as Minimum
from .minimize import minimize_by_preference as minimize_by_preference
from .optional import OPTIONAL as _OPTIONAL
from .optional import optional as _optional
from .registry import restore as restore
from .respacing import respaced as respaced

if _TYPE_CHECKING:
    from .peers import OptunaPreferential as OptunaPreferential
    from .peers import ReferenceGLIS as ReferenceGLIS
    from .peers import ReferenceGLISp as ReferenceGLISp
    from .rl import PPOBandit as PPOBandit
    from .rl import SACBandit as SACBandit


def __getattr__(name: str) -> _Any:
    if name in _OPTIONAL:
        return _optional(name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
