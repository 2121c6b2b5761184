"""Run one θ in several scenes, with another estimator or other limits."""

from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_env.envs.overtake import Course, OvertakeOptions
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.experiments.rollout import rollout
from prefcal_env.experiments.worst_case import worst_of
from prefcal_env.knobs.knob import KnobSpace
from prefcal_env.mpc import EstimatorSettings
from prefcal_scenarios.scenario import Scenario

from .controller import SPACE, Fixed, controller, settings
from .kpis import HIGHER_IS_BETTER, indicators
from .supervisor import Supervisor


@dataclass(frozen=True, slots=True)
class Scenes:
    """What a scenario runs that has other scenes, another estimator or other limits.

    Args:
        options: One or more scenes; of several the worst counts.
        estimator: Of the controller; None: it believes what it measures.
        fixed: What the tuning leaves alone.
    """

    options: tuple[OvertakeOptions, ...]
    estimator: EstimatorSettings | None
    fixed: Fixed

    def run(
        self, theta: Float[np.ndarray, " 5"], seed: int = 0, space: KnobSpace = SPACE
    ) -> Experiment:
        """Every scene once; the noise and the random traffic of scene i follow from (seed, i).

        Raises:
            KnobError: θ of the wrong shape, NaN or outside of `space`.
        """
        theta = space.check(theta)
        runs = []
        for i, options in enumerate(self.options):
            of_run = int(np.random.SeedSequence([seed, i]).generate_state(1)[0])
            driver = self.controller(theta, space)
            runs.append(rollout(Course(options), driver, theta, seed=of_run, kpis=indicators))
        return runs[0] if len(runs) == 1 else worst_of(runs, HIGHER_IS_BETTER)

    def controller(self, theta: Float[np.ndarray, " 5"], space: KnobSpace = SPACE) -> Supervisor:
        """A fresh controller of θ. Raises as `run`."""
        return controller(theta, self.fixed, self.estimator, space)

    def settings(self, theta: Float[np.ndarray, " 5"], space: KnobSpace = SPACE) -> dict[str, Any]:
        """Those of the MPCs, and of the estimator if there is one."""
        found = settings(theta, space, self.fixed)
        return found if self.estimator is None else found | {"estimator": asdict(self.estimator)}

    def of(self, scenario: Scenario) -> Scenario:
        """`scenario` with these scenes in place of its own."""
        return replace(
            scenario, run=self.run, controller=self.controller, settings=self.settings
        )  # fmt: skip
