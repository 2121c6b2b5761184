"""Figures of the benchmark."""

from .drawing import Look as Look
from .drawing import looks as looks
from .lines import against as against
from .lines import along as along
from .summaries import summary as summary
