"""Random closed loops: smooth ones, and rough ones as they are met in practice."""

from .family import loop as loop
from .family import rough_model as rough_model
from .rough import rough_loop as rough_loop
