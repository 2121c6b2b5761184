"""Scenarios: case studies that come with prefcal, and people's own.

Importing this package registers `prefcal/CSTRTuning-v0` and `prefcal/OvertakeTuning-v0` with
Gymnasium by name, in which an action is a θ, beside the environments of `prefcal_env`. The names
below are imported on first use.
"""

from typing import TYPE_CHECKING

from gymnasium import register

import prefcal_env as prefcal_env
from prefcal_env.on_first_use import public_names

if TYPE_CHECKING:
    from .catalog import load as load
    from .runs import FailedRun as FailedRun
    from .runs import outcome as outcome
    from .runs import simulate_iter as simulate_iter
    from .runs import simulate_many as simulate_many
    from .runs import simulator as simulator
    from .scenario import KPI as KPI
    from .scenario import Panel as Panel
    from .scenario import Scenario as Scenario

__getattr__, __dir__, __all__ = public_names(__name__)

for _name, _case in (("CSTR", "cstr"), ("Overtake", "overtake")):
    register(
        f"prefcal/{_name}Tuning-v0",
        f"prefcal_scenarios.cases.{_case}:make_tuning_env",
        vector_entry_point=f"prefcal_scenarios.cases.{_case}:make_tuning_vector",
    )
