"""The report of a study: figures, tables, the tuned controller, all in one folder."""

from prefcal_scenarios.report.record import Record as Record
from prefcal_scenarios.report.record import Trial as Trial

__all__ = ["Record", "Trial"]
