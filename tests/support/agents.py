"""Agents of the registry, so that a new row is tested without another list."""

from collections.abc import Callable
from typing import Any

from prefcal_agents.registry import AGENTS


def agents_without_extra(*, by_value: bool = False) -> dict[str, Callable[..., Any]]:
    """Return what makes each agent that needs no extra, by name, for one kind of agents."""
    return {row.name: row.load() for row in AGENTS if row.by_value is by_value and not row.extra}


def peers(*, by_value: bool = False) -> dict[str, Callable[..., Any]]:
    """Return what makes each agent of other people's packages, by name, for one kind of agents."""
    rows = [row for row in AGENTS if row.extra == "peers" and row.by_value is by_value]
    return {row.name: row.load() for row in rows}
