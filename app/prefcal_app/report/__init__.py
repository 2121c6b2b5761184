"""Write the report of a study, with figures, tables and the tuned controller, to one folder.

The names are imported on first use: what draws takes a second to import.
"""

from typing import TYPE_CHECKING

from prefcal_env.on_first_use import public_names

if TYPE_CHECKING:
    from .record import StudyRecord as StudyRecord

__getattr__, __dir__, __all__ = public_names(__name__)
