"""Live plants: prefcal writes θ, starts, records and restores the old θ, after a confirmation."""

from .description import live_rig as live_rig
from .journal import Journal as Journal
from .opcua import OPCUAPlant as OPCUAPlant
from .parts import LiveKnob as LiveKnob
from .parts import LiveStart as LiveStart
from .parts import Tag as Tag
from .plant import LivePlant as LivePlant
from .progress import Driven as Driven
from .rig import LiveRig as LiveRig
