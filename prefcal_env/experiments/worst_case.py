"""Combine several runs of one θ into one experiment: a θ is as good as its worst run."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from prefcal_env.errors import ExperimentError

from .end import BEST_FIRST
from .experiment import Experiment


def worst_of(runs: Sequence[Experiment], higher_is_better: Collection[str] = ()) -> Experiment:
    """Combine several runs of the same θ into one experiment.

    Arrays are those of the first run; KPIs and end are the worst of all runs. So the end may be
    "unsafe" although the arrays go on until time is up: to see how long all runs survived, look
    into `runs`, as `prefcal_env.calibrators.Lexicographic` does.

    Args:
        runs: One or more runs with the same θ and the same KPI names.
        higher_is_better: Names of the KPIs whose smallest value is the worst; for all others it
            is the largest.

    Returns:
        The first run, with all runs in order as its `runs`.

    Raises:
        ExperimentError: If there are no runs, they differ in θ or in their KPIs, a run is itself
            a combination, or a name in `higher_is_better` is unknown.
    """
    if not runs:
        raise ExperimentError("there must be one or more runs, got none")
    first, names = runs[0], set(runs[0].kpis)
    for run in runs:
        if not np.array_equal(run.theta, first.theta) or set(run.kpis) != names or run.runs:
            raise ExperimentError(
                "runs must be single runs of the same θ with the same KPIs; got "
                f"θ = {run.theta}, KPIs {sorted(run.kpis)} and θ = {first.theta}, "
                f"KPIs {sorted(names)}"
            )
    if not set(higher_is_better) <= names:
        raise ExperimentError(f"no KPI is called {sorted(set(higher_is_better) - names)}")
    return replace(
        first,
        kpis=_worst(runs, higher_is_better),
        end=max((run.end for run in runs), key=BEST_FIRST.index),
        runs=tuple(runs),
    )


def _worst(runs: Sequence[Experiment], higher_is_better: Collection[str]) -> Mapping[str, float]:
    """Return the worst value of each KPI; NaN is worse than any number."""
    return {
        name: float(
            (np.min if name in higher_is_better else np.max)([run.kpis[name] for run in runs])
        )
        for name in runs[0].kpis
    }
