"""The report of a study: figures, tables, the tuned controller, all in one folder."""

from .record import Record as Record
from .record import Trial as Trial

__all__ = ["Record", "Trial"]
