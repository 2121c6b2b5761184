"""Closed loops of control practice, by name."""

from prefcal_scenarios.scenario import Scenario

from .family import LOOPS as LOOPS
from .family import named as named


def __getattr__(name: str) -> Scenario:
    """Return the loop called `name`, such as "cart-pole", for `load`."""
    if name in LOOPS:
        return named(name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
