"""The figures of the benchmark."""

from .duels import heat_map as heat_map
from .gaps import against_experiments as against_experiments
from .gaps import against_questions as against_questions
from .profiles import data_profiles as data_profiles
from .ranking import ranking as ranking
from .seconds import seconds as seconds
