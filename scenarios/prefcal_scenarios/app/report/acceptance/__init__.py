"""Write the acceptance sheet: what changes on the plant, before and after, on one printed page."""

from .sheet import FILE as FILE
from .sheet import sheet as sheet
