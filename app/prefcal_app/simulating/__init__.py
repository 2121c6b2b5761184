"""Simulate many θ that nobody looks at, for the agent Screening, while a person compares others.

`Simulator` runs them, in worker processes or in this one, and `Basis` is what the open question was
chosen from. `Screened` and `why` say what a person sees of that.
"""

from .basis import Basis as Basis
from .basis import Carried as Carried
from .basis import Simulated as Simulated
from .basis import past_of as past_of
from .basis import simulates as simulates
from .kept import Kept as Kept
from .kept import key_of as key_of
from .screened import Prospect as Prospect
from .screened import Screened as Screened
from .simulator import Abandoned as Abandoned
from .simulator import Simulator as Simulator
from .twin import named_twin as named_twin
from .twin import twin_of as twin_of
from .why import as_shown as as_shown
from .why import at_stake as at_stake
from .why import carried_by as carried_by
from .why import menu_names as menu_names
from .why import wanted as wanted
from .why import why as why
