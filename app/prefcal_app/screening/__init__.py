"""What a person sees of an agent that simulates many θ and shows few."""

from .prospect import Prospect as Prospect
from .screened import Screened as Screened
from .why import as_shown as as_shown
from .why import why as why
