"""The benchmark: agents x problems x calibrators x seeds, resumable and deterministic.

In `cells`, `Suite` lists the cells, `run_suite` runs those without a result in a `Store` on
`Processes`, and `digest` tells whether two runs gave the same results. Importing this package makes
its simulated people calibrators of closed loops, lets `prefcal_agents.restore` restore its agents,
and `prefcal_scenarios.load` make random loops. prefcal imports it when something unknown is asked for.
"""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from prefcal_agents.registry import FAMILIES, JUDGES, register

from .peers import BANDITS, PEERS

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


def __getattr__(name: str) -> Any:
    from prefcal_env.on_first_use import public_names  # here: `prefcal --help` need not load it

    return public_names(__name__).load(name)


def __dir__() -> list[str]:
    from prefcal_env.on_first_use import public_names

    return public_names(__name__).listed()


def _simulated_people(scenario: Any) -> Mapping[str, Callable[[int], Any]]:
    from .people.named import calibrators_of  # draws random experiments only when one is asked for

    return calibrators_of(scenario)


def _loop(seed: int) -> Any:
    from .loops import loop  # loads numba

    return loop(seed)


def _rough_loop(seed: int) -> Any:
    from .loops import rough_loop

    return rough_loop(seed)


register(*BANDITS, *PEERS)
JUDGES.append(_simulated_people)
FAMILIES.update({"loop": _loop, "rough": _rough_loop})
