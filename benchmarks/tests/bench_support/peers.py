"""Agents of other people's packages, so that a new row is tested without another list."""

from collections.abc import Callable
from typing import Any

from prefcal_bench.peers import PEERS


def peers(*, by_value: bool = False) -> dict[str, Callable[..., Any]]:
    """Return what makes each of them, by name, for one kind of agents."""
    return {row.name: row.load() for row in PEERS if row.by_value is by_value}
