"""KPIs of many experiments side by side, as tastes compare them."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float, Int

from prefcal_env.experiments.experiment import Experiment
from prefcal_scenarios.scenario import KPI

from .looks import LOOKS, looks_of


@dataclass(frozen=True, eq=False, slots=True)
class Runs:
    """KPIs of K experiments; lower is better in every column.

    Args:
        names: Names of the KPIs.
        values: KPIs, infinite where one could not be measured, shape (K, m).
        survived: Time until each experiment was interrupted, in the scenario's unit; infinite if
            it was not. Shape (K,).
        z: θ in the unit cube, shape (J, n), where J is K, or 0 if they are not known.
        seen: What is seen in the curves, as in `LOOKS`, shape (L, f), where L is K or 0.
    """

    names: tuple[str, ...]
    values: Float[np.ndarray, "K m"]
    survived: Float[np.ndarray, " K"]
    z: Float[np.ndarray, "J n"] = field(default_factory=lambda: np.zeros((0, 0)))
    seen: Float[np.ndarray, "L f"] = field(default_factory=lambda: np.zeros((0, 0)))

    def __len__(self) -> int:
        return len(self.survived)

    def column(self, name: str) -> Float[np.ndarray, " K"]:
        """Return the KPI or the look called `name` of every experiment, shape (K,)."""
        if name in LOOKS and name not in self.names:
            return self.seen[:, LOOKS.index(name)]
        return self.values[:, self.names.index(name)]

    def take(self, rows: Int[np.ndarray, " k"]) -> "Runs":
        """Return the experiments in `rows`, shape (k,), in that order."""
        seen = self.seen[rows] if self.seen.size else self.seen
        return Runs(self.names, self.values[rows], self.survived[rows], seen=seen)


def runs_of(kpis: Sequence[KPI], experiments: Sequence[Experiment]) -> Runs:
    """Return the runs for `experiments`, with those `kpis` that have a direction."""
    judged = [kpi for kpi in kpis if kpi.goal is not None]
    values = [[_badness(kpi, experiment) for kpi in judged] for experiment in experiments]
    return Runs(
        names=tuple(kpi.name for kpi in judged),
        values=np.array(values, dtype=float).reshape(len(experiments), len(judged)),
        survived=np.array([_survived(experiment) for experiment in experiments], dtype=float),
        seen=np.array([looks_of(experiment) for experiment in experiments], dtype=float).reshape(
            len(experiments), len(LOOKS)
        ),
    )


def _badness(kpi: KPI, experiment: Experiment) -> float:
    value = float(kpi.badness(experiment.kpis.get(kpi.name, np.nan)))
    return np.inf if np.isnan(value) else value


def _survived(experiment: Experiment) -> float:
    """Return the time it survived; of several variants, that of the first one to be stopped."""
    variants = experiment.runs or (experiment,)
    return min(e.duration if e.end.interrupted else np.inf for e in variants)
