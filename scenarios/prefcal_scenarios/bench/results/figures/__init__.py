"""Figures of the benchmark."""

from .curves import against_experiments as against_experiments
from .curves import against_questions as against_questions
from .curves import data_profiles as data_profiles
from .drawing import Look as Look
from .drawing import looks as looks
from .summaries import heat_map as heat_map
from .summaries import ranking as ranking
from .summaries import seconds as seconds
