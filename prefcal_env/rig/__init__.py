"""Rigs: plants that only a person can run, and the records of these runs."""

from .records import Columns as Columns
from .rig import Rig as Rig
