"""The benchmark: agents x problems x calibrators x seeds, resumable and deterministic.

In `cells`, `Suite` lists the cells, `run_suite` runs those without a result in a `Store` on
`Processes`, and `digest` tells whether two runs gave the same results. Importing this package makes
its simulated people calibrators of closed loops, and lets `prefcal_agents.restore` restore its
agents.
"""

from collections.abc import Callable, Mapping
from typing import Any

from prefcal_agents.registry import JUDGES, register

from .peers import PEERS


def __getattr__(name: str) -> Any:
    from prefcal_env.on_first_use import public_names  # here: `prefcal --help` need not load it

    return public_names(__name__).load(name)


def _simulated_people(scenario: Any) -> Mapping[str, Callable[[int], Any]]:
    from .people.named import calibrators_of  # draws random experiments only when one is asked for

    return calibrators_of(scenario)


register(*PEERS)
JUDGES.append(_simulated_people)
