"""Draw tastes at random: what a person wants from a closed loop."""

from collections.abc import Callable, Mapping

import numpy as np

from .eyes import draw as eyes
from .limited import Limit, Limited
from .priorities import Priorities, Priority
from .rising import Standards
from .rule import Rule, minus
from .runs import Runs
from .usual import distance, good, some
from .weighted import Term, Weighted

Draw = Callable[[Runs, np.random.Generator], Rule]

_FIRST = (0.15, 0.5)
"""Share of random pairs that the first priority is meant to decide."""
_LATER = (0.7, 0.95)
_ACCEPTED = (0.08, 0.55)
"""Share of random pairs that the first priority does decide; KPIs beyond that come later."""
_LARGE = 1e9
_FINAL = 0.05
"""Share of the runs that meet the final standards in one KPI."""
_LEADERS = 0.1
"""Share of the runs, the best by some trade-off, one of which sets the limits."""


def weights(runs: Runs, rng: np.random.Generator) -> Weighted:
    """Return a trade-off between three KPIs or more, with diminishing returns."""
    return _weighted(runs, some(runs, rng, 3, len(runs.names)), rng)


def narrow(runs: Runs, rng: np.random.Generator) -> Weighted:
    """Return a trade-off between one or two KPIs only."""
    return _weighted(runs, some(runs, rng, 1, 2), rng)


def priorities(runs: Runs, rng: np.random.Generator) -> Priorities:
    """Return three priorities or more, with absolute and relative just noticeable differences.

    There are fewer if there are fewer KPIs.
    The first one decides 8 to 55 % of random pairs, the last one notices every difference.
    """
    names = some(runs, rng, 3, len(runs.names))
    pairs = rng.integers(len(runs), size=(2, 2000))
    a, b = runs.take(pairs[0]), runs.take(pairs[1])
    possible = [_priority(name, a, b, _FIRST, rng) for name in names]
    decided = [_decided(priority, a, b) for priority in possible]
    fits = [place for place, share in enumerate(decided) if _ACCEPTED[0] <= share <= _ACCEPTED[1]]
    middle = sum(_ACCEPTED) / 2
    first = fits[0] if fits else int(np.argmin(np.abs(np.array(decided) - middle)))
    rest = [name for place, name in enumerate(names) if place != first]
    if not rest:  # a single KPI
        return Priorities((Priority(names[0], 0.0),))
    later = [_priority(name, a, b, _LATER, rng) for name in rest[:-1]]
    return Priorities((possible[first], *later, Priority(rest[-1], 0.0)))


def limits(runs: Runs, rng: np.random.Generator) -> Limited:
    """Return limits on two or three KPIs near what a good run reaches, then a trade-off."""
    by = weights(runs, rng).cost(runs)
    leader = rng.choice(np.argsort(by, kind="stable")[: max(int(_LEADERS * len(runs)), 1)])
    found = []
    for name in some(runs, rng, 2, 3):
        best, typical = good(runs, name), distance(runs, name, 0.5)
        slack = rng.uniform(1.05, 1.5)
        reached = min(float(runs.column(name)[leader]), best + typical)
        found.append(Limit(name, best + slack * (reached - best) + 0.02 * typical, typical))
    return Limited(tuple(found), _weighted(runs, runs.names, rng))


def rising(runs: Runs, rng: np.random.Generator) -> Standards:
    """Return a trade-off whose standards start at the typical run and rise to the best ones."""
    final = weights(runs, rng)
    first, last = (
        Weighted(
            tuple(
                Term(t.name, t.weight, t.good, distance(runs, t.name, share), t.steepness)
                for t in final.terms
            )
        )
        for share in (0.75, _FINAL)
    )
    return Standards(first, last)


KINDS: Mapping[str, Draw] = {
    "weights": weights,
    "priorities": priorities,
    "limits": limits,
    "narrow": narrow,
    "hidden": narrow,
    "rising": rising,
    "order": eyes.order,
    "ideal": eyes.ideal,
    "majority": eyes.majority,
    "ranks": eyes.ranks,
    "curves": eyes.curves,
    "trade": eyes.trade,
}
"""Kinds of tastes; the KPIs of a hidden one are withheld from the agents.

The seed of a draw holds the place of its kind: new ones come last.
"""


def _weighted(runs: Runs, names: tuple[str, ...], rng: np.random.Generator) -> Weighted:
    shares = rng.dirichlet(np.full(len(names), 1.5))
    return Weighted(
        tuple(
            Term(
                name,
                weight=float(share),
                good=good(runs, name),
                scale=distance(runs, name, rng.uniform(0.05, 0.4)),
                steepness=float(2.0 ** rng.uniform(-1.0, 1.0)),
            )
            for name, share in zip(names, shares, strict=True)
        )
    )


def _priority(name: str, a: Runs, b: Runs, shares: tuple[float, float], rng: np.random.Generator) -> Priority:
    """Return a priority that decides about a share of the pairs, drawn from `shares`."""
    share, relative = rng.uniform(*shares), bool(rng.random() < 0.5)
    x, y = a.column(name), b.column(name)
    sizes = np.minimum(np.abs(minus(x, y)), _LARGE)
    if relative:
        larger = np.maximum(np.maximum(np.abs(x), np.abs(y)), 1 / _LARGE)
        sizes = np.where(np.isinf(larger), _LARGE, sizes / np.where(np.isinf(larger), 1.0, larger))
    usable = sizes[sizes < _LARGE]
    noticed = float(np.quantile(sizes, 1.0 - share)) if len(usable) else 0.0
    largest = float(usable.max(initial=0.0))
    return Priority(name, float(f"{min(noticed, largest):.2g}"), relative)


def _decided(priority: Priority, a: Runs, b: Runs) -> float:
    """Return the share of the pairs that survival leaves to this priority, and it decides."""
    together = np.isinf(a.survived) & np.isinf(b.survived)
    return float(np.mean((priority.compare(a, b) != 0) & together))
