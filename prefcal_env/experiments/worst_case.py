"""Several runs of one θ as one experiment: a θ is as good as its worst run."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from prefcal_env.errors import ExperimentError

from .end import End
from .experiment import Experiment

_BEST_FIRST = (End.SETTLED, End.TIME_UP, End.UNSAFE, End.FAILED)


def worst_of(runs: Sequence[Experiment], higher_is_better: Collection[str] = ()) -> Experiment:
    """One experiment of several runs of the same θ.

    Its arrays are those of the first run, its KPIs and its end the worst of all. So the end may
    be "unsafe" of arrays that go on until time is up: who asks for how long all of them survived
    must look into `runs`, as `prefcal_env.calibrators.Lexicographic` does.

    Args:
        runs: One or more, with the same θ and the same names of KPIs.
        higher_is_better: Names of the KPIs of which the smallest is the worst; of the others it is
            the largest.

    Returns:
        The first run, with `runs` all of them, in order.

    Raises:
        ExperimentError: no run, runs of different θ or with different KPIs, runs that hold runs,
            a name in `higher_is_better` that no KPI has.
    """
    if not runs:
        raise ExperimentError("the worst of no runs: expected one or more")
    first, names = runs[0], set(runs[0].kpis)
    for run in runs:
        if not np.array_equal(run.theta, first.theta) or set(run.kpis) != names or run.runs:
            raise ExperimentError(
                "runs must be single ones, of the same θ and with the same KPIs; got "
                f"θ = {run.theta}, KPIs {sorted(run.kpis)} beside θ = {first.theta}, "
                f"KPIs {sorted(names)}"
            )
    if not set(higher_is_better) <= names:
        raise ExperimentError(f"no KPI is called {sorted(set(higher_is_better) - names)}")
    return replace(
        first,
        kpis=_worst(runs, higher_is_better),
        end=max((run.end for run in runs), key=_BEST_FIRST.index),
        runs=tuple(runs),
    )


def _worst(runs: Sequence[Experiment], higher_is_better: Collection[str]) -> Mapping[str, float]:
    """NaN is the worst of all."""
    return {
        name: float(
            (np.min if name in higher_is_better else np.max)([run.kpis[name] for run in runs])
        )
        for name in runs[0].kpis
    }
