"""Verification: does a tuning hold if the plant is not exactly as it was modeled?

A source says what can be varied of it (`Source.varied`). `varied_runs` runs the variations on all cores.
`result` is what came of them, with the `nominal` of the nominal loop; `said` is what is kept and told.
"""

from typing import TYPE_CHECKING

from prefcal_env.on_first_use import public_names

if TYPE_CHECKING:
    from .result import Verification as Verification
    from .varied_runs import replay as replay
    from .varied_runs import verify as verify

__getattr__, __dir__, __all__ = public_names(__name__)
