"""Draw people with eyes: what they want, and the smallest difference that they notice."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Int

from prefcal_bench.people.looks import LOOKS
from prefcal_bench.people.runs import Runs
from prefcal_bench.people.usual import distance, finished, good, some, spread

from .ideal import Ideal, Wish
from .majority import Majority
from .noticing import Eyes, Judgement
from .order import Criterion, Order
from .ranks import Ranks, Scale
from .trade import Share, Trade

_BEST, _FEW = 0.025, 8
"""Share and least number of usual runs, the best ones, some pairs of which look alike."""
_WANTED = (0.12, 0.22)
"""Share of these pairs that are meant to be ties."""
_FINER = 0.8
"""Part of that in an order, where ties become more frequent the better the runs are."""
_FINEST, _COARSEST, _HALVINGS = 1e-4, 1e2, 16
_NOTICED = (0.03, 0.5)
"""Just noticeable differences before they are fitted, as shares of the spread of a KPI."""
_LIMIT = (0.05, 0.5)
"""Share of usual runs that keep a limit."""
_MARKS = 65
_SAME = 0.8
"""Share of usual runs that may have one value in a look; there is nothing to see in others."""


def order(runs: Runs, rng: np.random.Generator) -> Eyes:
    """Return an order of two KPIs or more, half of them with a limit, but not the last one."""
    *first, last = some(runs, rng, 2, len(runs.names))
    limited = [bool(rng.random() < 0.5) for _ in first]
    return _ordered(runs, rng, (*first, last), [*limited, False])


def ideal(runs: Runs, rng: np.random.Generator) -> Eyes:
    """Return an ideal run of three KPIs or more, near the best values, and how far counts."""
    power = float(rng.choice([1.0, 2.0, np.inf]))
    chosen = some(runs, rng, 3, len(runs.names))
    return _nearest(runs, rng, chosen, [float(rng.uniform(0.0, 0.1)) for _ in chosen], power)


def majority(runs: Runs, rng: np.random.Generator) -> Eyes:
    """Return votes of three or five KPIs, as far as there are so many."""
    count = int(rng.choice([3, 5]))
    sizes = {name: _size(runs, rng, name) for name in some(runs, rng, count, count)}

    def judging(factor: float) -> Judgement:
        return Majority(tuple(Criterion(n, factor * size) for n, size in sizes.items()))

    return _with_eyes(judging, runs, rng)


def ranks(runs: Runs, rng: np.random.Generator) -> Eyes:
    """Return a sum of ranks of three KPIs or more."""
    scales = tuple(_scale(runs, name) for name in some(runs, rng, 3, len(runs.names)))
    return _with_eyes(lambda factor: Ranks(scales, factor), runs, rng)


def trade(runs: Runs, rng: np.random.Generator) -> Eyes:
    """Return a trade-off between three KPIs or more."""
    chosen = some(runs, rng, 3, len(runs.names))
    shares = tuple(
        Share(
            name,
            weight=float(weight),
            good=good(runs, name),
            scale=distance(runs, name, rng.uniform(0.05, 0.5)),
            power=float(rng.uniform(1.0, 2.0)),
        )
        for name, weight in zip(chosen, rng.dirichlet(np.full(len(chosen), 1.5)), strict=True)
    )
    return _with_eyes(lambda factor: Trade(shares, factor), runs, rng)


def curves(runs: Runs, rng: np.random.Generator) -> Eyes:
    """Return what two to four looks decide, in an order or by their sum.

    Runs without curves are judged by their KPIs.
    """
    visible = [name for name in LOOKS if runs.seen.size and _varies(runs, name)] or runs.names
    count = min(int(rng.integers(2, 5)), len(visible))
    chosen = tuple(visible[i] for i in rng.permutation(len(visible))[:count])
    if rng.random() < 0.5:
        return _ordered(runs, rng, chosen, [False] * count)
    return _nearest(runs, rng, chosen, [0.0] * count, 1.0)


def _ordered(runs: Runs, rng: np.random.Generator, names: tuple[str, ...], limited: list[bool]) -> Eyes:
    sizes = [_size(runs, rng, name) for name in names]
    limits = [
        float(np.quantile(finished(runs, name), rng.uniform(*_LIMIT))) if has else -np.inf
        for name, has in zip(names, limited, strict=True)
    ]

    def judging(factor: float) -> Judgement:
        rows = zip(names, sizes, limits, strict=True)
        return Order(tuple(Criterion(n, factor * size, limit) for n, size, limit in rows))

    return _with_eyes(judging, runs, rng, part=_FINER)


def _nearest(
    runs: Runs, rng: np.random.Generator, names: tuple[str, ...], shares: list[float], power: float
) -> Eyes:
    wishes = tuple(
        Wish(
            name,
            value=float(np.quantile(finished(runs, name), share)),
            scale=spread(runs, name) * float(np.exp(rng.uniform(-0.7, 0.7))),
        )
        for name, share in zip(names, shares, strict=True)
    )
    return _with_eyes(lambda factor: Ideal(wishes, power, factor), runs, rng)


def _with_eyes(
    judging: Callable[[float], Judgement], runs: Runs, rng: np.random.Generator, part: float = 1.0
) -> Eyes:
    """Return the person who cannot tell some pairs of the best runs apart.

    `judging` takes the factor of all just noticeable differences, which is found by bisection.
    Who is best depends on it, so that it is found twice.
    """
    wanted, factor = part * rng.uniform(*_WANTED), 0.1
    for _ in range(2):
        pairs = best_pairs(Eyes(judging(factor)), runs)
        low, high = _FINEST, _COARSEST
        for _ in range(_HALVINGS):
            factor = float(np.sqrt(low * high))
            share = alike(Eyes(judging(factor)), *pairs)
            low, high = (factor, high) if share < wanted else (low, factor)
    return Eyes(judging(float(f"{factor:.3g}")))


def alike(rule: Eyes, a: Runs, b: Runs) -> float:
    """Return the share of pairs that are ties; 0 without any."""
    return float(np.mean(rule.compare(a, b) == 0)) if len(a) else 0.0


def best_pairs(rule: Eyes, runs: Runs) -> tuple[Runs, Runs]:
    """Return all pairs of the best runs, a fortieth of them, which the fewest runs beat."""
    rows, count = range(len(runs)), max(round(_BEST * len(runs)), _FEW)
    beaten = [np.count_nonzero(rule.compare(runs, runs.take(np.array([k]))) < 0) for k in rows]
    best: Int[np.ndarray, " k"] = np.argsort(beaten, kind="stable")[:count]
    first, second = np.triu_indices(len(best), 1)
    return runs.take(best[first]), runs.take(best[second])


def _size(runs: Runs, rng: np.random.Generator, name: str) -> float:
    """Return a just noticeable difference of a KPI before it is fitted, in the KPI's unit."""
    return spread(runs, name) * float(np.exp(rng.uniform(*np.log(_NOTICED))))


def _scale(runs: Runs, name: str) -> Scale:
    values = finished(runs, name)
    marks, counts = np.unique(values, return_counts=True)
    shares = (np.cumsum(counts) - counts / 2) / len(values)
    kept = np.unique(np.linspace(0, len(marks) - 1, _MARKS).round().astype(int))
    return Scale(name, tuple(marks[kept].tolist()), tuple(shares[kept].tolist()))


def _varies(runs: Runs, name: str) -> bool:
    """Return whether there is something to see: values differ in a fifth of the runs or more."""
    _, counts = np.unique(finished(runs, name), return_counts=True)
    return bool(counts.max() <= _SAME * counts.sum())
