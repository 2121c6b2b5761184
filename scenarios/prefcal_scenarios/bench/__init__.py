"""The benchmark: agents x problems x calibrators x seeds, resumable and deterministic.

`Suite` lists the cells, `run_suite` runs those without a result in a `Store` on `Processes`,
and `digest` tells whether two runs gave the same results.
"""

from .cell import Cell as Cell
from .duels import Duel as Duel
from .executors import Processes as Processes
from .result import Result as Result
from .result import digest as digest
from .run import run_cell as run_cell
from .runner import Finished as Finished
from .runner import run_suite as run_suite
from .store import Store as Store
from .suite import Suite as Suite
