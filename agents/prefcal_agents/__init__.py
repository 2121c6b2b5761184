"""Agents: they propose θ and learn from preferences."""

from .glis import GLIS as GLIS
from .glis_settings import GLISSettings as GLISSettings
from .glisp import GLISp as GLISp
from .latin_hypercube import LatinHypercube as LatinHypercube
from .minimize import Minimum as Minimum
from .minimize import minimize_by_preference as minimize_by_preference
from .random_search import RandomSearch as RandomSearch
from .restore import restore as restore
from .settings import GLISpSettings as GLISpSettings
from .state import AgentState as AgentState
