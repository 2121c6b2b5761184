"""The acceptance sheet of a study: one page, before and after, with lines to sign."""

from .sheet import FILE as FILE
from .sheet import sheet as sheet
from .sheet import sheet_of as sheet_of
