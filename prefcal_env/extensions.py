"""Find what other distributions add to prefcal: agents, people who answer, scenarios and commands.

They are listed as entry points of installed distributions. Looking for them takes some 20 ms, so
this happens only when something unknown is asked for.
"""

from functools import cache
from importlib.metadata import EntryPoint, entry_points

BENCHMARK = "pip install prefcal-bench (in a clone: pip install ./benchmarks)"
"""How to install the benchmark, which has most of what is missing without it."""


@cache
def load_extensions() -> None:
    """Import the modules of the group `prefcal.extensions`, which register what they add; once."""
    for found in entry_points(group="prefcal.extensions"):
        found.load()


def command(name: str) -> EntryPoint | None:
    """Return the command called `name` of the group `prefcal.commands`; None if there is none."""
    return next(iter(entry_points(group="prefcal.commands", name=name)), None)
