"""Present the results of a campaign: tables, figures, and one page with both."""

from .duelling import duel_table as duel_table
from .rows import as_csv as as_csv
from .rows import table as table
from .terminal import print_table as print_table
from .write import write as write

__all__ = ["as_csv", "duel_table", "print_table", "table", "write"]
