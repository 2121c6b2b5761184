"""Live plants: prefcal writes θ, starts, records and restores the old θ, after a confirmation."""

from .drive import Driven as Driven
from .opcua import OPCUAPlant as OPCUAPlant
from .plan import Journal as Journal
from .plan import LiveKnob as LiveKnob
from .plan import LivePlant as LivePlant
from .plan import LiveStart as LiveStart
from .plan import Tag as Tag
from .rig import LiveRig as LiveRig
from .rig import live_rig as live_rig
