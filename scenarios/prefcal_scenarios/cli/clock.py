"""The clock of a study's record."""

from datetime import UTC, datetime


def wall_clock() -> str:
    """Now, in UTC, for the record; no result depends on it."""
    return datetime.now(UTC).isoformat(timespec="milliseconds")
