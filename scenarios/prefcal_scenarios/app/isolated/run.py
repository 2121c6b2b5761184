"""Move the run of a scenario into the process of the user's code."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import SettingsError
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.live import LiveRig
from prefcal_env.rig import Rig
from prefcal_scenarios.scenario import Scenario, is_own

from .worker import DEFAULT_LIMIT, Worker


@dataclass(frozen=True, slots=True)
class IsolatedRun:
    """A run of θ in the process of `worker`.

    Args:
        worker: Worker that runs θ.
        space: Ranges of the study, if they were changed; those of the scenario if None.
    """

    worker: Worker
    space: KnobSpace | None = None

    def __call__(self, theta: Float[np.ndarray, " n"], seed: int = 0) -> Experiment:
        """Run θ, physical, shape (n,). Raises RunError if there is no experiment."""
        return self.worker.run(theta, seed, self.space)

    def within(self, space: KnobSpace) -> "IsolatedRun":
        """Return the same run with the ranges of `space`."""
        return replace(self, space=space)


@contextmanager
def isolation(
    source: str, limit: float = DEFAULT_LIMIT, *, early: bool = True
) -> Iterator[Callable[[Scenario], Scenario]]:
    """Yield a function that moves the runs of a scenario into a separate process.

    Built-in scenarios, which always end, and rigs, which a person runs, are not moved.

    Args:
        source: Name of the scenario, or path/to/own.py:NAME.
        limit: Maximum number of seconds of a run; infinite for no limit.
        early: Whether the process starts at once, to load the file while prefcal does, or only
            when needed.

    Raises:
        SettingsError: If the limit is not above 0.
    """
    if not limit > 0:
        raise SettingsError(f"--run-timeout must be above 0 s, got {limit:g}")
    if not is_own(source):
        yield lambda scenario: scenario
        return
    worker = Worker(source, limit)

    def isolated(scenario: Scenario) -> Scenario:
        if isinstance(scenario.run, Rig | LiveRig):
            worker.close()
            return scenario
        return replace(scenario, run=IsolatedRun(worker))

    if early:
        worker.start()
    try:
        yield isolated
    finally:
        worker.close()
