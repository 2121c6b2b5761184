"""The benchmark: agents x problems x calibrators x seeds, resumable and deterministic.

`Suite` lists the cells, `run_suite` runs those without a result in a `Store` on `Processes`,
and `digest` tells whether two runs gave the same results. Names are imported on first use, so that
`prefcal --help` does not load plants and solvers. Importing this package makes its simulated people
calibrators of closed loops, and lets `prefcal_agents.restore` restore its agents.
"""

from collections.abc import Callable, Mapping
from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from prefcal_agents.registry import JUDGES, register

from .peers import PEERS

if TYPE_CHECKING:
    from .cells.cell import Cell as Cell
    from .cells.cell import Result as Result
    from .cells.cell import digest as digest
    from .cells.duels import Duel as Duel
    from .cells.engine import Processes as Processes
    from .cells.run import run_cell as run_cell
    from .cells.runner import SuiteResults as SuiteResults
    from .cells.runner import run_suite as run_suite
    from .cells.store import Store as Store
    from .cells.suite import Suite as Suite
    from .peers.botorch_agents import BOPE as BOPE
    from .peers.botorch_agents import EUBO as EUBO
    from .peers.optuna_agents import OptunaGP as OptunaGP
    from .peers.optuna_agents import OptunaPreferential as OptunaPreferential
    from .peers.optuna_agents import OptunaTPE as OptunaTPE
    from .peers.reference import ReferenceGLIS as ReferenceGLIS
    from .peers.reference import ReferenceGLISp as ReferenceGLISp

_HOMES = {
    "Cell": "cells.cell",
    "Duel": "cells.duels",
    "SuiteResults": "cells.runner",
    "Processes": "cells.engine",
    "Result": "cells.cell",
    "Store": "cells.store",
    "Suite": "cells.suite",
    "digest": "cells.cell",
    "run_cell": "cells.run",
    "run_suite": "cells.runner",
    **{row.name: row.module for row in PEERS},
}

__all__ = list(_HOMES)


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(import_module(f".{_HOMES[name]}", __name__), name)
    if not name.startswith("_") and find_spec(f"{__name__}.{name}") is not None:
        return import_module(f".{name}", __name__)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOMES})


def _simulated_people(scenario: Any) -> Mapping[str, Callable[[int], Any]]:
    from .people.named import calibrators_of  # draws random experiments only when one is asked for

    return calibrators_of(scenario)


register(*PEERS)
JUDGES.append(_simulated_people)
