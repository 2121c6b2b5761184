"""Verification: does a tuning hold if the plant is not exactly as it was modeled?

`factor` is one thing that varies, `subject` a scenario with what can vary: `loops` and `plants` are any
closed loop, `compiled` those that come with prefcal, `cases` finds which it is. `verify` runs the
variations on all cores, `result` is what came of them, and `verified` what is kept of it.
"""

from .factor import Factor as Factor
from .result import Verification as Verification
from .verify import replay as replay
from .verify import verify as verify
