"""People's own files: loading them, checking them, and naming the line of an error."""

from collections.abc import Callable

say: Callable[[str], None] | None = None
"""Function that tells that a file takes long to load; only the command line sets it."""
