"""Run a user's own scenario in a separate process, so that no run can stop prefcal.

The process is a fresh (spawned) interpreter instead of a fork or a fork server: when it is
restarted after a failed run, prefcal has threads (web server, experiments, compiled code), and a
fork copies their locks in any state. The fresh interpreter loads the user's file itself, so nothing
needs to be picklable: θ goes in, the bytes of an experiment come out.
"""

from .own_run import OwnRun as OwnRun
from .run import IsolatedRun as IsolatedRun
from .run import isolation as isolation
from .worker import DEFAULT_LIMIT as DEFAULT_LIMIT
from .worker import Worker as Worker
from .worker import in_time as in_time
