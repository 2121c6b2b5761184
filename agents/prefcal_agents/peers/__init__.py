"""Provide optimizers from other packages as agents, for comparison; needs the extra `peers`."""

from .bope import BOPE as BOPE
from .eubo import EUBO as EUBO
from .optuna_agents import OptunaGP as OptunaGP
from .optuna_agents import OptunaPreferential as OptunaPreferential
from .optuna_agents import OptunaTPE as OptunaTPE
from .reference import ReferenceGLIS as ReferenceGLIS
from .reference import ReferenceGLISp as ReferenceGLISp
