"""Scenarios: case studies that come with prefcal, and people's own.

Importing this package registers `prefcal/CSTRTuning-v0` and `prefcal/OvertakeTuning-v0` with
Gymnasium by name, in which an action is a θ, beside the environments of `prefcal_env`. The names
below are imported on first use.
"""

from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from gymnasium import register

import prefcal_env as prefcal_env

if TYPE_CHECKING:
    from .catalog import load as load
    from .kpis import outcome as outcome
    from .kpis import screened as screened
    from .kpis import simulator as simulator
    from .many.results import FailedRun as FailedRun
    from .many.results import Simulated as Simulated
    from .many.simulate import simulate_iter as simulate_iter
    from .many.simulate import simulate_many as simulate_many
    from .scenario import KPI as KPI
    from .scenario import Panel as Panel
    from .scenario import Scenario as Scenario

_HOMES = {
    "outcome": "kpis",
    "screened": "kpis",
    "simulator": "kpis",
    "FailedRun": "many.results",
    "Simulated": "many.results",
    "simulate_iter": "many.simulate",
    "simulate_many": "many.simulate",
    "KPI": "scenario",
    "Panel": "scenario",
    "Scenario": "scenario",
    "load": "catalog",
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


for _name, _case in (("CSTR", "cstr"), ("Overtake", "overtake")):
    register(
        f"prefcal/{_name}Tuning-v0",
        f"prefcal_scenarios.cases.{_case}:make_tuning_env",
        vector_entry_point=f"prefcal_scenarios.cases.{_case}:make_tuning_vector",
    )
