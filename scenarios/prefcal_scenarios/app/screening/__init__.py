"""What a person sees of an agent that simulates many θ and shows few."""

from .prospect import Prospect as Prospect
from .screened import Screened as Screened
from .why import good_on_average as good_on_average
from .why import why as why
