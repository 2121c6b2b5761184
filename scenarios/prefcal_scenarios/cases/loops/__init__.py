"""Closed loops of control practice: named ones, and a generator of random ones."""

from .family import LOOPS as LOOPS
from .family import loop as loop
from .family import named as named
