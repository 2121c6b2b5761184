"""Case studies, the report of a study, and the command line `prefcal`."""

from .export import load_controller as load_controller
from .scenario import KPI as KPI
from .scenario import Panel as Panel
from .scenario import Scenario as Scenario
from .scenario import load as load
