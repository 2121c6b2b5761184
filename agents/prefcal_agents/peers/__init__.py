"""Other people's optimisers as agents, to compare with: the extra `peers` installs them."""

from .optuna_preferential import OptunaPreferential as OptunaPreferential
from .reference_glis import ReferenceGLIS as ReferenceGLIS
from .reference_glisp import ReferenceGLISp as ReferenceGLISp
