"""The benchmark: agents x problems x calibrators x seeds, resumable and deterministic.

`Suite` says which cells there are, `run_suite` runs those that a `Store` has no result of on
`Processes` or a `DaskCluster`, `digest` tells whether two runs gave the same.
"""

from .cell import Cell as Cell
from .result import Result as Result
