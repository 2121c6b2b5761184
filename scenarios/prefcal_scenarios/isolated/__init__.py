"""Run a user's own scenario in a separate process, so that no run can stop prefcal.

The process loads the user's file itself, so nothing needs to be picklable: θ goes in, the bytes of
an experiment come out.
"""

from .own_run import OwnSource as OwnSource
from .run import DEFAULT_LIMIT as DEFAULT_LIMIT
from .run import Isolated as Isolated
from .run import isolation as isolation
