"""Runs of a user's own scenario in a process of their own: no such run can stop prefcal.

Why a fresh interpreter (spawned), neither a fork nor a fork server: prefcal has threads when a run
fails and the process is started again (web server, experiments, compiled code), and a fork copies
their locks in whatever state they are. The fresh one loads the user's file itself, so nothing in
it has to be picklable: θ goes in, the bytes of an experiment come out.
"""

from .run import IsolatedRun as IsolatedRun
from .run import isolation as isolation
from .worker import DEFAULT_LIMIT as DEFAULT_LIMIT
from .worker import Worker as Worker
from .worker import in_time as in_time
