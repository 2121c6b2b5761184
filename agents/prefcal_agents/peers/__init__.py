"""Provide optimizers from other packages as agents, for comparison; needs the extra `peers`."""

from .optuna_preferential import OptunaPreferential as OptunaPreferential
from .reference_glis import ReferenceGLIS as ReferenceGLIS
from .reference_glisp import ReferenceGLISp as ReferenceGLISp
