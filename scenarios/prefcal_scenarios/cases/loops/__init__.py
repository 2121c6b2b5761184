"""Closed loops of control practice: named ones, and a generator of random ones."""

from prefcal_scenarios.scenario import Scenario

from .family import LOOPS as LOOPS
from .family import loop as loop
from .family import named as named
from .family import rough_model as rough_model
from .rough import rough_loop as rough_loop

_RANDOM = {"loop": loop, "rough": rough_loop}


def __getattr__(name: str) -> Scenario:
    """Return the loop called `name`, such as "cart-pole", "loop-17" or "rough-17", for `load`."""
    kind, _, seed = name.rpartition("-")
    if kind in _RANDOM and seed.isdecimal():
        return _RANDOM[kind](int(seed))
    if name in LOOPS:
        return named(name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
