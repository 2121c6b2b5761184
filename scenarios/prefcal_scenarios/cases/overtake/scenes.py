"""Run one θ in several scenes, with another estimator or other limits."""

from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_env.envs.overtake import Course, OvertakeOptions
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.experiments.rollout import rollout
from prefcal_env.experiments.worst_case import worst_of
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.mpc import EstimatorSettings
from prefcal_scenarios.scenario import Scenario

from .controller import SPACE, Fixed, controller, settings
from .kpis import HIGHER_IS_BETTER, compute_kpis
from .supervisor import Supervisor


@dataclass(frozen=True, slots=True)
class Scenes:
    """The scenes, estimator and fixed settings that a scenario runs with.

    Args:
        options: Options of one or more scenes; the worst counts.
        estimator: Estimator of the controller; None trusts the measurement.
        fixed: MPC settings that are not tuned.
    """

    options: tuple[OvertakeOptions, ...]
    estimator: EstimatorSettings | None
    fixed: Fixed

    def run(
        self, theta: Float[np.ndarray, " 5"], seed: int = 0, space: KnobSpace = SPACE
    ) -> Experiment:
        """Run every scene once; noise and random traffic of scene i follow from (seed, i).

        Raises:
            KnobError: If θ has the wrong shape, is NaN, or is outside `space`.
        """
        theta = space.check(theta)
        runs = []
        for i, options in enumerate(self.options):
            of_run = int(np.random.SeedSequence([seed, i]).generate_state(1)[0])
            driver = self.controller(theta, space)
            runs.append(rollout(Course(options), driver, theta, seed=of_run, kpis=compute_kpis))
        return runs[0] if len(runs) == 1 else worst_of(runs, HIGHER_IS_BETTER)

    def controller(self, theta: Float[np.ndarray, " 5"], space: KnobSpace = SPACE) -> Supervisor:
        """Create the controller of θ. Raises like `run`."""
        return controller(theta, self.fixed, self.estimator, space)

    def settings(self, theta: Float[np.ndarray, " 5"], space: KnobSpace = SPACE) -> dict[str, Any]:
        """Return the settings of the MPCs, and of the estimator if there is one."""
        found = settings(theta, space, self.fixed)
        return found if self.estimator is None else found | {"estimator": asdict(self.estimator)}

    def of(self, scenario: Scenario) -> Scenario:
        """Return `scenario` with these scenes instead of its own."""
        return replace(scenario, run=self.run, controller=self.controller, settings=self.settings)
