"""Models made with other libraries: linear systems of python-control and SciPy, CasADi functions.

None of these libraries is imported: their objects are recognized by what they have.
"""

from .linear import LinearPlant as LinearPlant
from .matrices import LinearSystem as LinearSystem
from .matrices import system_of as system_of
