"""Why an experiment ended. Besides the KPIs, this is all that an agent learns about a run."""

from enum import Enum


class End(Enum):
    """Why an experiment ended; `CUT_SHORT`: it was stopped since it could no longer win."""

    TIME_UP = "time is up"
    SETTLED = "settled"
    CUT_SHORT = "cut short"
    UNSAFE = "unsafe"
    FAILED = "failed"

    @property
    def interrupted(self) -> bool:
        """Whether it was stopped before its natural end."""
        return self in (End.CUT_SHORT, End.UNSAFE, End.FAILED)


BEST_FIRST = (End.SETTLED, End.TIME_UP, End.CUT_SHORT, End.UNSAFE, End.FAILED)
"""Ends of a run, from the best to the worst."""
