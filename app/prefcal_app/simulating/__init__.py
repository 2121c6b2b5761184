"""Simulate many θ that nobody looks at, for the agent Screening, while a person compares others.

`Simulator` runs them, in worker processes or in this one, and `Basis` is what the open question was
chosen from. `Screened` and `why` say what a person sees of that.
"""

from .simulator import Abandoned as Abandoned
from .simulator import Basis as Basis
from .simulator import Carried as Carried
from .simulator import Kept as Kept
from .simulator import Simulated as Simulated
from .simulator import Simulator as Simulator
from .simulator import key_of as key_of
from .simulator import named_twin as named_twin
from .simulator import past_of as past_of
from .simulator import simulates as simulates
from .simulator import twin_of as twin_of
from .why import Prospect as Prospect
from .why import Screened as Screened
from .why import as_shown as as_shown
from .why import at_stake as at_stake
from .why import carried_by as carried_by
from .why import menu_names as menu_names
from .why import wanted as wanted
from .why import why as why
