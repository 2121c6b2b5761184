"""Combine runs of one θ under different conditions, its maneuvers, into one experiment."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from prefcal_env.errors import ExperimentError

from .end import BEST_FIRST
from .experiment import Channels, Experiment

MEAN = "mean"
"""What the mean over all maneuvers is called: "NAME (mean)". No maneuver can have this name."""

_ARRAYS = ("t", "x", "u", "t_control", "u_control", "y_ref", "iterations", "solve_time", "solved")


def combined(
    runs: Sequence[Experiment],
    *,
    higher_is_better: Collection[str] = (),
    targets: Mapping[str, float] | None = None,
) -> Experiment:
    """Combine the maneuvers of one θ into one experiment, which is as good as its worst maneuver.

    Each KPI that a maneuver returns is stored as "NAME (MANEUVER)". The KPI called NAME is the
    worst of all maneuvers, so the KPIs of a scenario, their limits and agents need nothing else;
    "NAME (mean)" is the mean. A KPI of one maneuver alone has no mean. If an interrupted maneuver
    lacks a KPI that others have, its worst and its mean are left out: they are unknown.

    Args:
        runs: One or more runs of the same θ, each with its own `maneuver` name.
        higher_is_better: Names of the KPIs whose smallest value is the worst.
        targets: Names of the KPIs whose worst value is the one farthest from a target, and that
            target in the KPI's unit. For all other KPIs the largest value is the worst.

    Returns:
        The first run without its maneuver name, with all maneuvers in order as its `runs`, and the
        worst end of all.

    Raises:
        ExperimentError: If there are no runs, a maneuver has no name or the name of another one,
            the runs differ in θ or in the names of their channels, a run is itself a combination,
            or no run has a KPI called as in `higher_is_better` or `targets` says, although
            none was interrupted.
    """
    targets = {} if targets is None else targets
    _check(runs)
    names = dict.fromkeys(name for run in runs for name in run.kpis)
    unknown = sorted({*higher_is_better, *targets} - set(names))
    if unknown and names and not any(run.end.interrupted for run in runs):
        raise ExperimentError(
            f"higher_is_better and targets must name KPIs of the maneuvers, got {unknown}; "
            f"there are {sorted(names)}"
        )
    badness = {name: _badness(name, higher_is_better, targets) for name in names}
    return replace(
        runs[0],
        kpis=_kpis(runs, badness),
        end=max((run.end for run in runs), key=BEST_FIRST.index),
        runs=tuple(runs),
        maneuver="",
    )


def by_maneuver(experiment: Experiment) -> dict[str, Experiment]:
    """Return the runs of the maneuvers by name, or the experiment itself as "" if it has none.

    Other runs of one experiment are no maneuvers: they are drawn together.
    """
    if any(run.maneuver for run in experiment.runs):
        return {run.maneuver: run for run in experiment.runs}
    return {"": experiment}


def maneuvers_of(*experiments: Experiment) -> dict[str, tuple[Experiment, ...]]:
    """Return the runs of each maneuver by its name, in the order of the experiments.

    If no experiment has maneuvers, the experiments themselves are called "". One that lacks a
    maneuver, because it failed or ran before the maneuver was added, has no record there.
    """
    parts = [by_maneuver(experiment) for experiment in experiments]
    names = dict.fromkeys(name for part in parts for name in part if name) or {"": None}
    return {
        name: tuple(
            part[name] if name in part else without_record(experiment)
            for part, experiment in zip(parts, experiments, strict=True)
        )
        for name in names
    }


def without_record(experiment: Experiment) -> Experiment:
    """Return `experiment` with its θ and channels only: no instants, no KPIs, no runs."""
    nothing: dict[str, Any] = {name: getattr(experiment, name)[:0] for name in _ARRAYS}
    return replace(experiment, **nothing, y=None, signals={}, runs=(), kpis={})


def named(kpi: str, part: str) -> str:
    """Return the name of a KPI in one maneuver, or of its mean: "NAME (PART)"."""
    return f"{kpi} ({part})"


def _check(runs: Sequence[Experiment]) -> None:
    if not runs:
        raise ExperimentError("there must be one or more maneuvers, got none")
    for k, run in enumerate(runs):
        check_name(run.maneuver)
        if run.maneuver in [other.maneuver for other in runs[:k]]:
            raise ExperimentError(f"two maneuvers are called {run.maneuver!r}: rename one of them")
        if run.runs:
            raise ExperimentError(
                f"maneuver {run.maneuver!r} must be a single run, got a combination of {len(run.runs)} runs"
            )
        if not np.array_equal(run.theta, runs[0].theta):
            raise ExperimentError(
                f"maneuvers must run the same θ, got {runs[0].theta} in {runs[0].maneuver!r} and "
                f"{run.theta} in {run.maneuver!r}"
            )
    check_channels({run.maneuver: run.channels for run in runs})


def check_name(name: object) -> None:
    """Raise ExperimentError unless a maneuver may be called `name`."""
    if not isinstance(name, str) or not name.strip() or not name.isprintable() or name == MEAN:
        raise ExperimentError(
            f"a maneuver needs a name of its own other than {MEAN!r}, such as 'step', got {name!r}"
        )


def check_channels(declared: Mapping[str, Channels]) -> None:
    """Raise ExperimentError if maneuvers differ in the names or units of their channels."""
    for what, part in _ALIKE.items():
        found = {name: part(channels) for name, channels in declared.items()}
        first = next(iter(found), "")
        for name in found:
            if found[name] != found[first]:
                raise ExperimentError(
                    f"maneuvers must have the same {what}, got {found[first]!r} in {first!r} and "
                    f"{found[name]!r} in {name!r}"
                )


_ALIKE: Mapping[str, Callable[[Channels], object]] = {
    "states": lambda channels: [c.label for c in channels.x],
    "inputs": lambda channels: [c.label for c in channels.u],
    "outputs": lambda channels: [c.label for c in channels.y],
    "unit of time": lambda channels: channels.time_unit,
}
"""What all maneuvers have in common."""


def _badness(
    name: str, higher_is_better: Collection[str], targets: Mapping[str, float]
) -> Callable[[float], float]:
    if name in targets:
        return lambda value: abs(value - targets[name])
    return (lambda value: -value) if name in higher_is_better else (lambda value: value)


def _kpis(runs: Sequence[Experiment], badness: Mapping[str, Callable[[float], float]]) -> dict[str, float]:
    """Return the worst of each KPI, then the means, then the KPIs of each maneuver."""
    known = {
        name: [float(run.kpis[name]) for run in runs if name in run.kpis]
        for name in badness
        if all(name in run.kpis or not run.end.interrupted for run in runs)
    }
    # NaN is worse than any number.
    worst = {
        name: next((v for v in values if np.isnan(v)), max(values, key=badness[name]))
        for name, values in known.items()
    }
    means = {named(n, MEAN): float(np.mean(v)) for n, v in known.items() if len(v) > 1}
    each = {named(n, run.maneuver): float(v) for run in runs for n, v in run.kpis.items()}
    clashes = sorted(set(worst) & set(means | each))
    if clashes:
        raise ExperimentError(f"the KPI {clashes[0]!r} has the name of a KPI in one maneuver: rename it")
    return {**worst, **means, **each}
