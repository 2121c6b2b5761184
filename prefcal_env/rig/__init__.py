"""A rig: a plant that only a person can run, and the records that he brings of it."""

from .records import Columns as Columns
from .rig import Rig as Rig
