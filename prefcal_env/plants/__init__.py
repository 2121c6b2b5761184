"""Plants: dynamic models of the systems that are controlled."""

from .cstr import CSTR as CSTR
from .cstr import CSTRParams as CSTRParams
from .function_plant import FunctionPlant as FunctionPlant
from .plant import Jacobians as Jacobians
from .plant import Plant as Plant
