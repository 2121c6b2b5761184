"""What a model of KPIs may learn from runs that were cut short."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from prefcal_env.preferences.answer import Answer
from prefcal_env.preferences.history import Comparison, History
from prefcal_env.preferences.kpis import Outcome

from .lessons import cube_of, kpis_of


def judged(history: History) -> History:
    """Return `history` for a model that learns from KPIs; the same object if no run was cut short.

    The KPIs of a run that was cut short are lower bounds. Whole runs of similar θ have larger ones,
    so each KPI becomes that of the nearest θ whose run was completed before, or its bound if that
    is larger. Answers about such a run teach nothing about KPIs: they follow from what was learned,
    or are about half a run.
    """
    cut = history.cut_short()
    if not cut:
        return history
    z, known = cube_of(history), kpis_of(history)
    partial = cut | history.unsafe()
    whole = [i for i, kpis in enumerate(known) if _is_whole(kpis) and i not in partial]
    filled = {i: _filled(z, known, [w for w in whole if w < i], i) for i in sorted(cut)}

    def taught(c: Comparison) -> Comparison:
        if c.challenger not in cut and c.incumbent not in cut:
            return c
        pair = c.answer.outcomes or (None, None)
        new = filled.get(c.challenger, pair[0])
        old = pair[1] if c.incumbent is None else filled.get(c.incumbent, pair[1])
        silent = Answer(None, marks=c.answer.marks, outcomes=(new, old))
        return replace(c, answer=silent)

    return replace(
        history,
        comparisons=tuple(taught(c) for c in history.comparisons),
        follow_ups=tuple(taught(c) for c in history.follow_ups),
    )


def _is_whole(kpis: Mapping[str, float]) -> bool:
    """Return whether all KPIs are known and finite; an interrupted run has infinite ones.

    A completed run that never settles is left out, too: both look alike here.
    """
    return bool(kpis) and bool(np.isfinite(list(kpis.values())).all())


def _filled(
    z: Float[np.ndarray, "N n"],
    known: tuple[Mapping[str, float], ...],
    whole: list[int],
    index: int,
) -> Outcome:
    """Return the KPIs of sample `index`, whose run was cut short, as those of a whole run."""
    bounds = known[index]
    if not whole:
        return Outcome(bounds)
    apart = np.sum((z[whole] - z[index]) ** 2, axis=1)
    near = known[whole[int(np.argmin(apart))]]
    return Outcome({
        name: max(bounds.get(name, -np.inf), near.get(name, -np.inf))
        for name in {*bounds, *near}
    })  # fmt: skip
