"""Figures of the benchmark."""

from .drawing import Look as Look
from .drawing import looks as looks
from .lines import against_experiments as against_experiments
from .lines import against_questions as against_questions
from .lines import along as along
from .lines import data_profiles as data_profiles
from .lines import worth_by_answers as worth_by_answers
from .lines import worth_by_experiments as worth_by_experiments
from .summaries import heat_map as heat_map
from .summaries import improvements as improvements
from .summaries import ranking as ranking
from .summaries import seconds as seconds
from .summaries import summary as summary
