"""Write the report of a study, with figures, tables and the tuned controller, to one folder."""

from .record import Record as Record
from .record import Trial as Trial

__all__ = ["Record", "Trial"]
