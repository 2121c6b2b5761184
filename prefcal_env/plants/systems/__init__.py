"""Linear systems as plants: of SciPy, plain arrays, or an optional world, none of which is imported."""

from .linear import LinearPlant as LinearPlant
from .matrices import LinearSystem as LinearSystem
from .matrices import system_of as system_of
