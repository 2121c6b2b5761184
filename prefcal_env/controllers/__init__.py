"""Controllers ready to use: a PID of the field's standard form, LQR and LQG."""

from .linearized import Linearized as Linearized
from .lqg import LQG as LQG
from .lqr import LQR as LQR
from .pid import PID as PID
from .pid import Decentralized as Decentralized
from .stored import as_data as as_data
from .stored import from_data as from_data
