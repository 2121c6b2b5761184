"""Simulate many θ that nobody looks at, for the agent Screening, while a person compares others.

`Simulator` runs them, in worker processes or in this one, and `Screened` is what the open question was
chosen from. `why` and what stands beside it put the agent's `Findings` into words.
"""

from .simulator import Abandoned as Abandoned
from .simulator import Screened as Screened
from .simulator import SimulationCounts as SimulationCounts
from .simulator import SimulationFile as SimulationFile
from .simulator import Simulator as Simulator
from .simulator import key_of as key_of
from .simulator import named_twin as named_twin
from .simulator import past_of as past_of
from .simulator import simulates as simulates
from .simulator import twin_of as twin_of
from .why import UNLIKELY as UNLIKELY
from .why import as_shown as as_shown
from .why import at_stake as at_stake
from .why import carried_by as carried_by
from .why import chance_left as chance_left
from .why import menu_names as menu_names
from .why import name_wishes as name_wishes
from .why import named_titles as named_titles
from .why import offer as offer
from .why import promise as promise
from .why import rival as rival
from .why import robust as robust
from .why import robust_study as robust_study
from .why import told as told
from .why import why as why
