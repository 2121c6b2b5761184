"""Sources turn θ into experiments; a run is one experiment under way.

A function, a closed loop, a rig that a person runs, a live plant, maneuvers, and work in another
process stand behind the same calls. Nobody asks a source what it is: it says what it asks of people.
"""

from .rig import Rig as Rig
from .source import Change as Change
from .source import Maneuvers as Maneuvers
from .source import PlantTrial as PlantTrial
from .source import Progress as Progress
from .source import Run as Run
from .source import RunCurve as RunCurve
from .source import Source as Source
from .source import Stage as Stage
from .source import Table as Table
