"""Compare agents in pairs of one loop and one seed, and write tables in Markdown."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from .statistics import Estimate, geometric_mean

Study = tuple[str, int]
"""Loop and seed."""


def mean_of(found: Mapping[Study, float]) -> Estimate | None:
    """Return the geometric mean over loops, each counting the same; None without studies.

    The interval is a bootstrap over the seeds of each loop.
    """
    by_loop: dict[str, list[float]] = {}
    for (loop, _), value in sorted(found.items()):
        by_loop.setdefault(loop, []).append(value)
    if not by_loop:
        return None
    loops = [np.array(values) for values in by_loop.values()]
    return geometric_mean(loops, rng=np.random.default_rng(0))


def ratio_of(ours: Mapping[Study, float], theirs: Mapping[Study, float]) -> Estimate | None:
    """Return the geometric mean of the ratio, in pairs of one loop and seed."""
    return mean_of({study: ours[study] / theirs[study] for study in ours if study in theirs})


def interval(found: Estimate | None, digits: int = 0) -> str:
    """Return a number with its 95 % interval, as far as it is known."""
    if found is None:
        return "–"
    if found.low is None:
        return f"{found.value:.{digits}f}"
    return f"{found.value:.{digits}f} [{found.low:.{digits}f}, {found.high:.{digits}f}]"


def markdown(head: Sequence[str], rows: Iterable[Sequence[object]]) -> list[str]:
    """Return the lines of a table in Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return [f"| {' | '.join(map(str, cells))} |" for cells in lines]
