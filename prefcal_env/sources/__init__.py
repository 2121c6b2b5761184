"""Sources turn θ into experiments; a run is one experiment under way.

A function, a closed loop, a rig that a person runs, a live plant, maneuvers, and work in another
process stand behind the same calls. Nobody asks a source what it is: it says what it asks of people.
"""

from .maneuvers import Maneuvers as Maneuvers
from .rig import Rig as Rig
from .run import Change as Change
from .run import Progress as Progress
from .run import Run as Run
from .run import RunCurve as RunCurve
from .run import Stage as Stage
from .run import Table as Table
from .source import Source as Source
