"""Case studies, the report of a study, and the command line `prefcal`.

Names are imported on first use, so that `prefcal --help` does not load plants and solvers.
"""

from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from prefcal_scenarios.app.looking.look import look as look
    from prefcal_scenarios.app.notebook import ask as ask
    from prefcal_scenarios.app.report.export import load_controller as load_controller
    from prefcal_scenarios.app.report.trajectories import figure as figure

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
    from .scenario import load as load

_HOMES = {
    "ask": "app.notebook",
    "figure": "app.report.trajectories",
    "load_controller": "app.report.export",
    "look": "app.looking.look",
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
    "load": "scenario",
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
