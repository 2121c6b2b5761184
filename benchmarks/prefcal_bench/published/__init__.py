"""Raw results as a file, and the studies that are published with prefcal."""

from .raw import read_curves as read_curves
from .raw import write_raw as write_raw
