"""Provide optimizers from other packages as agents, for comparison; needs the extra `peers`."""

from .bope import BOPE as BOPE
from .eubo import EUBO as EUBO
from .optuna_by_value import OptunaGP as OptunaGP
from .optuna_by_value import OptunaTPE as OptunaTPE
from .optuna_preferential import OptunaPreferential as OptunaPreferential
from .reference_glis import ReferenceGLIS as ReferenceGLIS
from .reference_glisp import ReferenceGLISp as ReferenceGLISp
