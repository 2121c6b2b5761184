"""Verification: does a tuning hold if the plant is not exactly as it was modeled?

`factor` is one thing that varies, `subject` finds what of a scenario can vary (`loops` and `plants`
for two kinds of closed loops), `verify` runs the variations on all cores, and `result` is what came
of them.
"""

from .factor import Factor as Factor
from .result import Verification as Verification
from .verify import replay as replay
from .verify import verify as verify
