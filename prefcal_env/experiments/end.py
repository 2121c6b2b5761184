"""Why an experiment ended. Besides the KPIs, this is all that an agent learns about a run."""

from enum import Enum


class End(Enum):
    """Why an experiment ended."""

    TIME_UP = "time is up"
    SETTLED = "settled"
    UNSAFE = "unsafe"
    FAILED = "failed"

    @property
    def interrupted(self) -> bool:
        """Whether it was stopped before its natural end."""
        return self in (End.UNSAFE, End.FAILED)


BEST_FIRST = (End.SETTLED, End.TIME_UP, End.UNSAFE, End.FAILED)
"""Ends of a run, from the best to the worst."""
