"""Controllers ready to use: a PID of the field's standard form, LQR and LQG."""

from .lqr import LQG as LQG
from .lqr import LQR as LQR
from .lqr import Linearized as Linearized
from .pid import PID as PID
from .pid import Decentralized as Decentralized
from .stored import as_data as as_data
from .stored import from_data as from_data
from .written import as_code as as_code
