"""Draw tastes at random: what a person wants from a closed loop, and what the person notices."""

from collections.abc import Callable, Mapping

import numpy as np
from jaxtyping import Float, Int

from .judgements import Loss, Majority, Noticed, Order, Rank, Total, Wish
from .looks import LOOKS
from .rule import Judgement, Noticing, Rule, minus
from .runs import Runs
from .trade_off import Standards, Term, TradeOff

Draw = Callable[[Runs, np.random.Generator], Rule]

_FIRST = (0.15, 0.5)  # share of random pairs that the first priority is meant to decide
_LATER = (0.7, 0.95)
_ACCEPTED = (0.08, 0.55)
"""Share of random pairs that the first priority does decide; KPIs beyond that come later."""
_LARGE = 1e9
_FINAL = 0.05  # share of the runs that meet the final standards in one KPI
_LEADERS = 0.1  # share of the runs, the best by some trade-off, one of which sets the limits
_BEST, _FEW = 0.025, 8  # share and least number of usual runs, the best ones, some pairs of which look alike
_WANTED = (0.12, 0.22)  # share of these pairs that are meant to be ties
_FINER = 0.8  # part of that in an order, where ties become more frequent the better the runs are
_FINEST, _COARSEST, _HALVINGS = 1e-4, 1e2, 16
_NOTICED = (0.03, 0.5)  # just noticeable differences before they are fitted, as shares of the spread of a KPI
_LIMIT = (0.05, 0.5)  # share of usual runs that keep a limit
_MARKS = 65
_SAME = 0.8  # share of usual runs that may have one value in a look; there is nothing to see in others


# What is usual.


def some(runs: Runs, rng: np.random.Generator, low: int, high: int) -> tuple[str, ...]:
    """Return between `low` and `high` names of KPIs in random order, as far as there are any."""
    high = min(high, len(runs.names))
    count = int(rng.integers(min(low, high), high + 1))
    return tuple(runs.names[i] for i in rng.permutation(len(runs.names))[:count])


def finished(runs: Runs, name: str) -> Float[np.ndarray, " k"]:
    """Return the finite values of runs that were not interrupted; a single 0 if there are none."""
    values = runs.column(name)[np.isinf(runs.survived)]
    finite = values[np.isfinite(values)]
    return finite if len(finite) else np.zeros(1)


def good(runs: Runs, name: str) -> float:
    """Return 0, or the lowest value if the KPI can be negative."""
    return min(float(finished(runs, name).min()), 0.0)


def distance(runs: Runs, name: str, share: float) -> float:
    """Return the quantile of the distance to the good value, above 0."""
    distances = finished(runs, name) - good(runs, name)
    positive = distances[distances > 0]
    if not len(positive):
        return 1.0
    return float(max(np.quantile(distances, share), positive.min()))


def spread(runs: Runs, name: str) -> float:
    """Return how far good runs and poor ones are apart: the 5 to the 80 % quantile, above 0."""
    values = finished(runs, name)
    low, high = np.quantile(values, (0.05, 0.8))
    return float(high - low) or float(np.ptp(values)) or 1.0


# People who notice every difference, at least in the end.


def weights(runs: Runs, rng: np.random.Generator) -> TradeOff:
    """Return a trade-off between three KPIs or more, with diminishing returns."""
    return TradeOff(_terms(runs, some(runs, rng, 3, len(runs.names)), rng))


def narrow(runs: Runs, rng: np.random.Generator) -> TradeOff:
    """Return a trade-off between one or two KPIs only."""
    return TradeOff(_terms(runs, some(runs, rng, 1, 2), rng))


def priorities(runs: Runs, rng: np.random.Generator) -> Noticing:
    """Return three priorities or more, with absolute and relative just noticeable differences.

    There are fewer if there are fewer KPIs.
    The first one decides 8 to 55 % of random pairs, the last one notices every difference.
    """
    names = some(runs, rng, 3, len(runs.names))
    pairs = rng.integers(len(runs), size=(2, 2000))
    a, b = runs.take(pairs[0]), runs.take(pairs[1])
    possible = [_priority(name, a, b, _FIRST, rng) for name in names]
    shares = [decided(priority, a, b) for priority in possible]
    fits = [place for place, share in enumerate(shares) if _ACCEPTED[0] <= share <= _ACCEPTED[1]]
    first = fits[0] if fits else int(np.argmin(np.abs(np.array(shares) - sum(_ACCEPTED) / 2)))
    rest = [name for place, name in enumerate(names) if place != first]
    later = [_priority(name, a, b, _LATER, rng) for name in rest[:-1]]
    # Of a single KPI every difference counts.
    order = (possible[first], *later, Noticed(rest[-1], 0.0)) if rest else (Noticed(names[0], 0.0),)
    return Noticing(Order(order), ties_count=True)


def limits(runs: Runs, rng: np.random.Generator) -> TradeOff:
    """Return limits on two or three KPIs near what a good run reaches, then a trade-off."""
    by = weights(runs, rng).cost(runs)
    leader = rng.choice(np.argsort(by, kind="stable")[: max(int(_LEADERS * len(runs)), 1)])
    found = []
    for name in some(runs, rng, 2, 3):
        best, typical = good(runs, name), distance(runs, name, 0.5)
        slack = rng.uniform(1.05, 1.5)
        reached = min(float(runs.column(name)[leader]), best + typical)
        found.append(Term(name, 1.0, best + slack * (reached - best) + 0.02 * typical, typical))
    return TradeOff(_terms(runs, runs.names, rng), tuple(found))


def rising(runs: Runs, rng: np.random.Generator) -> Standards:
    """Return a trade-off whose standards start at the typical run and rise to the best ones."""
    final = weights(runs, rng).terms

    def standards(share: float) -> TradeOff:
        scaled = ((t, distance(runs, t.name, share)) for t in final)
        return TradeOff(tuple(Term(t.name, t.weight, t.good, s, t.steepness) for t, s in scaled))

    return Standards(standards(0.75), standards(_FINAL))


def _terms(runs: Runs, names: tuple[str, ...], rng: np.random.Generator) -> tuple[Term, ...]:
    shares = rng.dirichlet(np.full(len(names), 1.5))
    return tuple(
        Term(
            name,
            weight=float(share),
            good=good(runs, name),
            scale=distance(runs, name, rng.uniform(0.05, 0.4)),
            steepness=float(2.0 ** rng.uniform(-1.0, 1.0)),
        )
        for name, share in zip(names, shares, strict=True)
    )


def _priority(name: str, a: Runs, b: Runs, shares: tuple[float, float], rng: np.random.Generator) -> Noticed:
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
    return Noticed(name, float(f"{min(noticed, largest):.2g}"), relative=relative)


def decided(priority: Noticed, a: Runs, b: Runs) -> float:
    """Return the share of the pairs that survival leaves to this priority, and it decides."""
    together = np.isinf(a.survived) & np.isinf(b.survived)
    return float(np.mean((priority.verdict(a, b) != 0) & together))


# People with eyes: to them, runs that differ by little are about the same.


def order(runs: Runs, rng: np.random.Generator) -> Noticing:
    """Return an order of two KPIs or more, half of them with a limit, but not the last one."""
    *first, last = some(runs, rng, 2, len(runs.names))
    limited = [bool(rng.random() < 0.5) for _ in first]
    return _ordered(runs, rng, (*first, last), [*limited, False])


def ideal(runs: Runs, rng: np.random.Generator) -> Noticing:
    """Return an ideal run of three KPIs or more, near the best values, and how far counts."""
    power = float(rng.choice([1.0, 2.0, np.inf]))
    chosen = some(runs, rng, 3, len(runs.names))
    return _nearest(runs, rng, chosen, [float(rng.uniform(0.0, 0.1)) for _ in chosen], power)


def majority(runs: Runs, rng: np.random.Generator) -> Noticing:
    """Return votes of three or five KPIs, as far as there are so many."""
    count = int(rng.choice([3, 5]))
    sizes = {name: _size(runs, rng, name) for name in some(runs, rng, count, count)}

    def judging(factor: float) -> Judgement:
        return Majority(tuple(Noticed(n, factor * size) for n, size in sizes.items()))

    return _with_eyes(judging, runs, rng)


def ranks(runs: Runs, rng: np.random.Generator) -> Noticing:
    """Return a sum of ranks of three KPIs or more."""
    parts = tuple(_rank(runs, name) for name in some(runs, rng, 3, len(runs.names)))
    return _with_eyes(lambda factor: Total(parts, factor), runs, rng)


def trade(runs: Runs, rng: np.random.Generator) -> Noticing:
    """Return a trade-off between three KPIs or more."""
    chosen = some(runs, rng, 3, len(runs.names))
    losses = tuple(
        Loss(
            name,
            weight=float(weight),
            good=good(runs, name),
            scale=distance(runs, name, rng.uniform(0.05, 0.5)),
            power=float(rng.uniform(1.0, 2.0)),
        )
        for name, weight in zip(chosen, rng.dirichlet(np.full(len(chosen), 1.5)), strict=True)
    )
    return _with_eyes(lambda factor: Total(losses, factor), runs, rng)


def curves(runs: Runs, rng: np.random.Generator) -> Noticing:
    """Return what two to four looks decide, in an order or by their sum.

    Runs without curves are judged by their KPIs.
    """
    visible = [name for name in LOOKS if runs.seen.size and _varies(runs, name)] or runs.names
    count = min(int(rng.integers(2, 5)), len(visible))
    chosen = tuple(visible[i] for i in rng.permutation(len(visible))[:count])
    if rng.random() < 0.5:
        return _ordered(runs, rng, chosen, [False] * count)
    return _nearest(runs, rng, chosen, [0.0] * count, 1.0)


def _ordered(runs: Runs, rng: np.random.Generator, names: tuple[str, ...], limited: list[bool]) -> Noticing:
    sizes = [_size(runs, rng, name) for name in names]
    at_most = [
        float(np.quantile(finished(runs, name), rng.uniform(*_LIMIT))) if has else -np.inf
        for name, has in zip(names, limited, strict=True)
    ]

    def judging(factor: float) -> Judgement:
        rows = zip(names, sizes, at_most, strict=True)
        return Order(tuple(Noticed(n, factor * size, limit) for n, size, limit in rows))

    return _with_eyes(judging, runs, rng, part=_FINER)


def _nearest(
    runs: Runs, rng: np.random.Generator, names: tuple[str, ...], shares: list[float], power: float
) -> Noticing:
    wishes = tuple(
        Wish(
            name,
            value=float(np.quantile(finished(runs, name), share)),
            scale=spread(runs, name) * float(np.exp(rng.uniform(-0.7, 0.7))),
        )
        for name, share in zip(names, shares, strict=True)
    )
    return _with_eyes(lambda factor: Total(wishes, factor, power), runs, rng)


def _with_eyes(
    judging: Callable[[float], Judgement], runs: Runs, rng: np.random.Generator, part: float = 1.0
) -> Noticing:
    """Return the person who cannot tell some pairs of the best runs apart.

    `judging` takes the factor of all just noticeable differences, which is found by bisection.
    Who is best depends on it, so that it is found twice.
    """
    wanted, factor = part * rng.uniform(*_WANTED), 0.1
    for _ in range(2):
        pairs = best_pairs(Noticing(judging(factor)), runs)
        low, high = _FINEST, _COARSEST
        for _ in range(_HALVINGS):
            factor = float(np.sqrt(low * high))
            share = alike(Noticing(judging(factor)), *pairs)
            low, high = (factor, high) if share < wanted else (low, factor)
    return Noticing(judging(float(f"{factor:.3g}")))


def alike(rule: Noticing, a: Runs, b: Runs) -> float:
    """Return the share of pairs that are ties; 0 without any."""
    return float(np.mean(rule.compare(a, b) == 0)) if len(a) else 0.0


def best_pairs(rule: Noticing, runs: Runs) -> tuple[Runs, Runs]:
    """Return all pairs of the best runs, a fortieth of them, which the fewest runs beat."""
    rows, count = range(len(runs)), max(round(_BEST * len(runs)), _FEW)
    beaten = [np.count_nonzero(rule.compare(runs, runs.take(np.array([k]))) < 0) for k in rows]
    best: Int[np.ndarray, " k"] = np.argsort(beaten, kind="stable")[:count]
    first, second = np.triu_indices(len(best), 1)
    return runs.take(best[first]), runs.take(best[second])


def _size(runs: Runs, rng: np.random.Generator, name: str) -> float:
    """Return a just noticeable difference of a KPI before it is fitted, in the KPI's unit."""
    return spread(runs, name) * float(np.exp(rng.uniform(*np.log(_NOTICED))))


def _rank(runs: Runs, name: str) -> Rank:
    values = finished(runs, name)
    marks, counts = np.unique(values, return_counts=True)
    shares = (np.cumsum(counts) - counts / 2) / len(values)
    kept = np.unique(np.linspace(0, len(marks) - 1, _MARKS).round().astype(int))
    return Rank(name, tuple(marks[kept].tolist()), tuple(shares[kept].tolist()))


def _varies(runs: Runs, name: str) -> bool:
    """Return whether there is something to see: values differ in a fifth of the runs or more."""
    _, counts = np.unique(finished(runs, name), return_counts=True)
    return bool(counts.max() <= _SAME * counts.sum())


KINDS: Mapping[str, Draw] = {
    "weights": weights,
    "priorities": priorities,
    "limits": limits,
    "narrow": narrow,
    "hidden": narrow,
    "rising": rising,
    "order": order,
    "ideal": ideal,
    "majority": majority,
    "ranks": ranks,
    "curves": curves,
    "trade": trade,
}
"""Kinds of tastes; the KPIs of a hidden one are withheld from the agents.

The seed of a draw holds the place of its kind: new ones come last.
"""
