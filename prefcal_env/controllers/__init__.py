"""Controllers ready to use: a PID of the field's standard form."""

from .decentralized import Decentralized as Decentralized
from .pid import PID as PID
from .stored import as_data as as_data
from .stored import from_data as from_data
