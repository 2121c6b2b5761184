"""Worth of the θ that agents find on closed loops: statistics, tables, figures and raw results.

The worth of a θ is how many random experiments it takes on average to find one at least as good,
so higher is better; 1 is the worst.
"""

from .curves import Curves as Curves
from .curves import curves_of as curves_of
from .curves import frame_of as frame_of
from .raw import read_curves as read_curves
from .raw import write_raw as write_raw
from .rows import worth_rows as worth_rows
from .rows import worth_table as worth_table
