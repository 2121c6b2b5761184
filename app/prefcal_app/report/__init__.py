"""Write the report of a study, with figures, tables and the tuned controller, to one folder."""

from .record import StudyRecord as StudyRecord
from .record import Trial as Trial

__all__ = ["StudyRecord", "Trial"]
