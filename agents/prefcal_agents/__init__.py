"""Provide agents that propose θ and learn from preferences or from scores.

The names below are imported on first use. `registry.py` lists all agents.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .baselines import GLIS as GLIS
    from .baselines import LatinHypercube as LatinHypercube
    from .baselines import RandomSearch as RandomSearch
    from .glisp.agent import GLISp as GLISp
    from .glisp.fits import GLISpSettings as GLISpSettings
    from .minimize import minimize_by_preference as minimize_by_preference
    from .registry import restore as restore
    from .screening.agent import Screening as Screening
    from .taste import Taste as Taste


def __getattr__(name: str) -> Any:
    from prefcal_env.on_first_use import public_names  # here: `prefcal --help` need not load it

    return public_names(__name__).load(name)


def __dir__() -> list[str]:
    from prefcal_env.on_first_use import public_names

    return public_names(__name__).listed()
