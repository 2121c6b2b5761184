"""Tables of logged data, and how to make experiments of them."""

from .frame import TableColumns as TableColumns
from .frame import from_frame as from_frame
