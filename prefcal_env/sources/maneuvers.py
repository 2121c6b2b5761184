"""Let one θ perform several maneuvers."""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import ExperimentError
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.experiments.maneuvers import MEAN, check_channels, check_name, combined, named
from prefcal_env.knobs.space import KnobSpace

from .function import source_of
from .source import KPIsOf, Source


class Maneuvers(Source):
    """A source that lets the same θ perform several maneuvers, and combines them.

    Args:
        runs: Maps the name of each maneuver to its run: a function `run(theta, seed=0)` that
            returns an `Experiment`, such as a `ClosedLoop` with another `Task`.
        higher_is_better: Names of the KPIs whose smallest value is the worst.
        targets: Names of the KPIs whose worst value is the one farthest from a target, and that
            target in the KPI's unit.

    Raises:
        ExperimentError: If there is no run, a name is empty or "mean", something is not a
            function, or the runs declare channels with different names.
    """

    def __init__(
        self,
        runs: Mapping[str, Callable[..., Experiment]],
        *,
        higher_is_better: Collection[str] = (),
        targets: Mapping[str, float] | None = None,
    ) -> None:
        if not isinstance(runs, Mapping) or not runs:
            raise ExperimentError(
                f'maneuvers must map names to runs, such as {{"step": run_1, "load": run_2}}, got {runs!r}'
            )
        for name, run in runs.items():
            check_name(name)
            if not callable(run):
                raise ExperimentError(f"maneuver {name!r} must be a function of θ, got {run!r}")
        if isinstance(higher_is_better, str):
            raise ExperimentError(f"higher_is_better must hold names of KPIs; write ({higher_is_better!r},)")
        self.maneuvers = {name: source_of(run) for name, run in runs.items()}
        self.higher_is_better = tuple(higher_is_better)
        self.targets = dict(targets or {})
        parts = list(self.maneuvers.values())
        check_channels({n: p.channels for n, p in self.maneuvers.items() if p.channels is not None})
        self.channels = parts[0].channels
        found = [part.signals for part in parts if part.signals is not None]
        if len(found) == len(parts):  # those that all of them have
            self.signals = tuple(key for key in found[0] if all(key in signals for signals in found))

    def _each(self, change: Callable[[Source], Source]) -> "Maneuvers":
        parts = {name: change(part) for name, part in self.maneuvers.items()}
        return Maneuvers(parts, higher_is_better=self.higher_is_better, targets=self.targets)

    def within(self, space: KnobSpace) -> "Maneuvers":
        """Return the same maneuvers for the ranges of `space`."""
        return self._each(lambda part: part.within(space))

    def measured(self, kpis_of: KPIsOf) -> "Maneuvers":
        """Return the same maneuvers, each of which has more KPIs than its own."""
        return self._each(lambda part: part.measured(kpis_of))

    def run(self, theta: Float[np.ndarray, " n"], seed: int = 0) -> Experiment:
        """Run all maneuvers of a physical θ, shape (n,), each with the same seed.

        Raises:
            ExperimentError: If a run returns something else than an experiment, or the
                experiments cannot be combined.
        """
        done = [_run(name, part, theta, seed) for name, part in self.maneuvers.items()]
        return combined(done, higher_is_better=self.higher_is_better, targets=self.targets)

    def problems(self, kpis: Iterable[Any]) -> Iterator[str]:
        """Yield the KPIs whose worst maneuver would be one of the better ones."""
        yield from super().problems(kpis)
        asking = [name for name, part in self.maneuvers.items() if part.asks]
        if asking:
            yield f"maneuver {asking[0]!r} must not be a rig, whose experiments a person runs one by one"
        parts = tuple(named("", part) for part in (*self.maneuvers, MEAN))
        for kpi in kpis:
            if kpi.name.endswith(parts):  # of one maneuver alone
                continue
            if kpi.goal == "higher" and kpi.name not in self.higher_is_better:
                yield (
                    f"KPI {kpi.name!r} is better when higher, so its worst maneuver has the "
                    f"smallest value: write Maneuvers(..., higher_is_better=({kpi.name!r},))"
                )
            if kpi.goal == "target" and kpi.name not in self.targets:
                middle = (kpi.at_least + kpi.at_most) / 2
                yield (
                    f"KPI {kpi.name!r} has a target, from which its worst maneuver is "
                    f"farthest: write Maneuvers(..., targets={{{kpi.name!r}: {middle:g}}})"
                )


def _run(name: str, part: Source, theta: Float[np.ndarray, " n"], seed: int) -> Experiment:
    found: object = part.run(theta, seed=seed)
    if not isinstance(found, Experiment):
        forgotten = ": is a return missing?" if found is None else ""
        raise ExperimentError(
            f"maneuver {name!r} must return an Experiment, got {type(found).__name__}{forgotten}"
        )
    return replace(found, maneuver=name)
