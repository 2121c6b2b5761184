"""Worker processes: the one family that runs whatever may die, hang or take too long.

`process` is one process from its start to its end, and `inside` what it does. A `worker` gives it
requests and replaces it, by one rule: a request whose process dies runs once more, alone, and has
then failed; one that takes too long, or is stopped, has failed. A `Pool` is several workers with
one queue. Each process is a fresh interpreter instead of a fork, which
would copy locks in any state, and needs no guard in people's scripts, as `multiprocessing` does.
"""

from .inside import failure as failure
from .worker import ATTEMPTS as ATTEMPTS
from .worker import GRACE as GRACE
from .worker import MARK as MARK
from .worker import Pool as Pool
from .worker import Terms as Terms
from .worker import Worker as Worker
from .worker import in_time as in_time
from .worker import run_all as run_all
from .worker import usable_cores as usable_cores
