"""Closed loops in FMUs (Functional Mock-up Units): θ are parameters, each run is simulated."""

from .loop import FMULoop as FMULoop
from .model import Model as Model
from .model import Variable as Variable
from .model import in_unit as in_unit
from .model import read_model as read_model
