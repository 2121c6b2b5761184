"""Run a user's own scenario in any worker process: each loads the user's file itself."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_env.experiments.experiment import Experiment
from prefcal_scenarios.catalog import load
from prefcal_scenarios.scenario import Run

from .inside import run_of
from .run import IsolatedRun
from .worker import ranges_of


@dataclass(frozen=True, slots=True)
class OwnRun:
    """The run of a user's own scenario; when it is unpickled, the user's file is loaded.

    Args:
        source: Source of the scenario, path/to/own.py:NAME.
        ranges: Ranges of the study as plain data; None for those of the scenario.
    """

    source: str
    ranges: dict[str, Any] | None

    @classmethod
    def of(cls, run: IsolatedRun) -> "OwnRun":
        """Return the run that `run` moved into a process."""
        return cls(run.worker.source, ranges_of(run.space))

    def __call__(self, theta: Float[np.ndarray, " n"], seed: int = 0) -> Experiment:
        """Run θ, physical, shape (n,), in this process."""
        return _loaded(self.source, self.ranges)(theta, seed=seed)

    def __reduce__(self) -> tuple[Any, ...]:
        return _loaded, (self.source, self.ranges)


def _loaded(source: str, ranges: dict[str, Any] | None) -> Run:
    """Return the run of the scenario, with the ranges of the study."""
    run: Run = run_of(load(source), ranges)
    return run
